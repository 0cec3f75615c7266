// What the two blending stages share: tiles to workers, blocks to pixels.
#pragma once
#include "machine/parallel.hpp"
#include "raster/raster.hpp"
#include "simd/simd.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

constexpr int BLOCKS_PER_SIDE = convention::TILE / convention::BLOCK;

struct Tile {
  int number;
  int left, top;             // pixels
  std::uint32_t begin, end;  // entries
  std::uint64_t inside;      // blocks that hold at least one pixel of the image
};

RINGLIGHT_INLINE Tile tile_at(const View& view, int number) {
  const int left = number % view.tiles_x * convention::TILE, top = number / view.tiles_x * convention::TILE;
  std::uint64_t inside = 0;
  for (int row = 0; row < BLOCKS_PER_SIDE; row++)
    for (int column = 0; column < BLOCKS_PER_SIDE; column++)
      if (top + convention::BLOCK * row < view.camera.height && left + convention::BLOCK * column < view.camera.width)
        inside |= std::uint64_t{1} << (BLOCKS_PER_SIDE * row + column);
  return {number, left, top, view.tile_starts[number], view.tile_starts[number + 1], inside};
}

// Offsets of a block's pixel centres from its upper left corner.
alignas(64) constexpr float CENTERS_X[LANES] = {.5f, 1.5f, 2.5f, 3.5f, .5f, 1.5f, 2.5f, 3.5f,
                                                .5f, 1.5f, 2.5f, 3.5f, .5f, 1.5f, 2.5f, 3.5f};
alignas(64) constexpr float CENTERS_Y[LANES] = {.5f,  .5f,  .5f,  .5f,  1.5f, 1.5f, 1.5f, 1.5f,
                                                2.5f, 2.5f, 2.5f, 2.5f, 3.5f, 3.5f, 3.5f, 3.5f};

RINGLIGHT_INLINE void prefetch_floats(const float* from, int count) {
  constexpr int LINE = 64 / sizeof(float);
  for (int i = 0; i < count; i += LINE) __builtin_prefetch(from + i);
  __builtin_prefetch(from + count - 1);
}

// The next tile that nobody has, longest first; false when all are taken.
RINGLIGHT_INLINE bool claim_tile(const View& view, int& claimed, Tile& tile) {
  const int i = __atomic_fetch_add(&claimed, 1, __ATOMIC_RELAXED);
  if (i >= view.tile_count) return false;
  tile = tile_at(view, static_cast<int>(view.tile_order[i]));
  return true;
}

// Calls body(tile, scratch) for every tile; `scratch` is the worker's own memory.
template <class F>
RINGLIGHT_INLINE void for_each_tile(const View& view, F&& body) {
  int claimed = 0;
  parallel_for(static_cast<std::size_t>(view.workers), [&](std::size_t worker) {
    Tile tile;
    while (claim_tile(view, claimed, tile)) body(tile, view.scratch + worker * view.scratch_stride);
  });
}

// Calls body(tile, next, scratch): a worker claims one tile ahead, so that `next`, null for its last one, can be
// fetched into the cache meanwhile. It may sit on a tile that an idle worker could have: for bodies that do fetch it.
template <class F>
RINGLIGHT_INLINE void for_each_tile_ahead(const View& view, F&& body) {
  int claimed = 0;
  parallel_for(static_cast<std::size_t>(view.workers), [&](std::size_t worker) {
    Tile tile, next{};
    for (bool more = claim_tile(view, claimed, tile); more; tile = next) {
      more = claim_tile(view, claimed, next);
      body(tile, more ? &next : nullptr, view.scratch + worker * view.scratch_stride);
    }
  });
}

}  // namespace ringlight::RINGLIGHT_ISA
