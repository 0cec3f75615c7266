// What the two blending stages share: tiles to workers, blocks to pixels.
#pragma once
#include "parallel.hpp"
#include "raster.hpp"
#include "simd.hpp"

namespace ringlight::RINGLIGHT_ISA {

constexpr int BLOCKS_PER_SIDE = convention::TILE / convention::BLOCK;

struct Tile {
  int number;
  int left, top;             // pixels
  std::uint32_t begin, end;  // entries
  std::uint64_t inside;      // blocks that hold at least one pixel of the image
};

RINGLIGHT_INLINE Tile tile_at(const Frame& frame, int number) {
  const int left = number % frame.tiles_x * convention::TILE, top = number / frame.tiles_x * convention::TILE;
  std::uint64_t inside = 0;
  for (int row = 0; row < BLOCKS_PER_SIDE; row++)
    for (int column = 0; column < BLOCKS_PER_SIDE; column++)
      if (top + convention::BLOCK * row < frame.camera.height && left + convention::BLOCK * column < frame.camera.width)
        inside |= std::uint64_t{1} << (BLOCKS_PER_SIDE * row + column);
  return {number, left, top, frame.tile_starts[number], frame.tile_starts[number + 1], inside};
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

// Calls body(tile, next, scratch) for every tile, longest first; `scratch` is the worker's own memory. A worker claims
// one tile ahead, so that `next`, null for its last one, can be fetched into the cache meanwhile.
template <class F>
RINGLIGHT_INLINE void for_each_tile(const Frame& frame, F&& body) {
  const int tiles = frame.tiles_x * frame.tiles_y;
  int unclaimed = 0;
  const auto claim = [&] { return __atomic_fetch_add(&unclaimed, 1, __ATOMIC_RELAXED); };
  parallel_for(static_cast<std::size_t>(frame.workers), [&](std::size_t worker) {
    float* const scratch = frame.scratch + worker * frame.scratch_stride;
    int i = claim();
    if (i >= tiles) return;
    for (Tile tile = tile_at(frame, static_cast<int>(frame.tile_order[i]));;) {
      i = claim();
      if (i >= tiles) return body(tile, static_cast<const Tile*>(nullptr), scratch);
      const Tile next = tile_at(frame, static_cast<int>(frame.tile_order[i]));
      body(tile, &next, scratch);
      tile = next;
    }
  });
}

}  // namespace ringlight::RINGLIGHT_ISA
