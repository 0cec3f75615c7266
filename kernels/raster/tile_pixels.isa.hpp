// Pixels of a tile between image planes, which are rows, and blocks of 4 x 4. Four blocks side by side, a *quartet*,
// move together: each of their four image rows is one whole Vec, and a quarter of it belongs to each block.
#pragma once
#include "raster/tiles.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

constexpr int QUARTET = 4;  // blocks

struct Quartet {
  int first_block;
  int x, y;           // pixels, upper left
  int columns, rows;  // pixels inside the image, at least one
};

// Calls body(quartet) for the quartets of a tile that hold pixels of the image.
template <class F>
RINGLIGHT_INLINE void for_each_quartet(const Camera& camera, const Tile& tile, F&& body) {
  constexpr int SIDE = convention::BLOCK, WIDTH = QUARTET * SIDE;
  for (int block = 0; block < BLOCKS; block += QUARTET) {
    const int x = tile.left + SIDE * (block % BLOCKS_PER_SIDE), y = tile.top + SIDE * (block / BLOCKS_PER_SIDE);
    const int right = camera.width - x, below = camera.height - y;
    if (right > 0 && below > 0) body(Quartet{block, x, y, right < WIDTH ? right : WIDTH, below < SIDE ? below : SIDE});
  }
}

// One Vec per block from an image plane; 0 outside the image.
RINGLIGHT_INLINE void load_quartet(const float* plane, std::size_t stride, const Quartet& quartet, Vec* blocks) {
  const float* from = plane + static_cast<std::size_t>(quartet.y) * stride + static_cast<std::size_t>(quartet.x);
  for (int row = 0; row < QUARTET; row++, from += stride) {
    if (quartet.columns == LANES && quartet.rows == QUARTET) blocks[row] = load(from);
    else blocks[row] = row < quartet.rows ? load_first(from, quartet.columns) : Vec(0.f);
  }
  transpose_quarters(blocks);
}

RINGLIGHT_INLINE void store_quartet(float* plane, std::size_t stride, const Quartet& quartet, Vec* blocks) {
  float* to = plane + static_cast<std::size_t>(quartet.y) * stride + static_cast<std::size_t>(quartet.x);
  transpose_quarters(blocks);
  for (int row = 0; row < QUARTET; row++, to += stride) {
    if (quartet.columns == LANES && quartet.rows == QUARTET) store(to, blocks[row]);
    else if (row < quartet.rows) store_first(to, blocks[row], quartet.columns);
  }
}

// Asks for a tile's pixels of some planes ahead of time. The rows of a tile are too far apart for the processor to
// guess them, and with few Gaussians per pixel to wait for them would be a quarter of the time.
RINGLIGHT_INLINE void prefetch_pixels(const View& view, const Tile& tile, const float* planes, int count) {
  constexpr int TILE = convention::TILE, LINE = 64 / sizeof(float);
  constexpr int MOST_PLANES = 32;  // of 4 KB each: more would not stay in the second-level cache
  const std::size_t stride = static_cast<std::size_t>(view.camera.width);
  const int right = view.camera.width - tile.left, below = view.camera.height - tile.top;
  const int columns = right < TILE ? right : TILE, rows = below < TILE ? below : TILE;
  const float* from = planes + static_cast<std::size_t>(tile.top) * stride + static_cast<std::size_t>(tile.left);
  for (int c = 0; c < count && c < MOST_PLANES; c++, from += stride * static_cast<std::size_t>(view.camera.height))
    for (int row = 0; row < rows; row++) {
      const float* const pixels = from + static_cast<std::size_t>(row) * stride;
      for (int x = 0; x < columns; x += LINE) __builtin_prefetch(pixels + x, 0, 2);
      __builtin_prefetch(pixels + columns - 1, 0, 2);
    }
}

}  // namespace ringlight::RINGLIGHT_ISA
