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

struct BlockPlace {
  int x, y;             // pixels, upper left
  bool whole;           // no pixel of it lies outside the image
  int columns, rows;    // pixels inside the image
};

RINGLIGHT_INLINE BlockPlace block_at(const Frame& frame, const Tile& tile, int block) {
  constexpr int SIDE = convention::BLOCK;
  const int x = tile.left + SIDE * (block % BLOCKS_PER_SIDE), y = tile.top + SIDE * (block / BLOCKS_PER_SIDE);
  const int right = frame.camera.width - x, below = frame.camera.height - y;
  return {x, y, right >= SIDE && below >= SIDE, right < SIDE ? right : SIDE, below < SIDE ? below : SIDE};
}

// Offsets of a block's pixel centres from its upper left corner.
alignas(64) constexpr float CENTERS_X[LANES] = {.5f, 1.5f, 2.5f, 3.5f, .5f, 1.5f, 2.5f, 3.5f,
                                                .5f, 1.5f, 2.5f, 3.5f, .5f, 1.5f, 2.5f, 3.5f};
alignas(64) constexpr float CENTERS_Y[LANES] = {.5f,  .5f,  .5f,  .5f,  1.5f, 1.5f, 1.5f, 1.5f,
                                                2.5f, 2.5f, 2.5f, 2.5f, 3.5f, 3.5f, 3.5f, 3.5f};

// Calls body(tile, scratch) for every tile, longest first; `scratch` is the worker's own memory.
template <class F>
RINGLIGHT_INLINE void for_each_tile(const Frame& frame, F&& body) {
  const int tiles = frame.tiles_x * frame.tiles_y;
  int next = 0;
  parallel_for(static_cast<std::size_t>(frame.workers), [&](std::size_t worker) {
    float* const scratch = frame.scratch + worker * frame.scratch_stride;
    for (int i; (i = __atomic_fetch_add(&next, 1, __ATOMIC_RELAXED)) < tiles;)
      body(tile_at(frame, static_cast<int>(frame.tile_order[i])), scratch);
  });
}

}  // namespace ringlight::RINGLIGHT_ISA
