// Counting sort by tile in two sweeps over the depth-sorted list. Each worker takes a consecutive part of it and has
// its own cursor in every tile, behind those of the parts in front: entries of a tile stay in depth order.
#include "bin.hpp"

#include <algorithm>
#include <numeric>
#include <utility>

#include "parallel.hpp"
#include "sort.hpp"

namespace ringlight {
namespace {

// Calls visit(tile number) for the tiles of a rectangle, in row-major order.
template <class Visit>
inline void for_tiles(const TileRect& rect, int tiles_x, Visit&& visit) {
  std::uint32_t tiles = rect.tiles;
  const int corner = rect.y0 * tiles_x + rect.x0;
  if (!(tiles & LISTED)) [[likely]] {
    if (tiles & 1) visit(corner);
    if (tiles & 2) visit(corner + 1);
    if (tiles & 4) visit(corner + tiles_x);
    if (tiles & 8) visit(corner + tiles_x + 1);
    return;
  }
  const bool every = tiles == EVERY_TILE;
  for (int y = rect.y0; y <= rect.y1; y++)
    for (int x = rect.x0; x <= rect.x1; x++, tiles >>= 1)
      if (every || (tiles & 1)) visit(y * tiles_x + x);
}

}  // namespace

void Binning::bin(Frame& frame, const std::uint64_t* order, std::size_t drawn) {
  const std::size_t segments = static_cast<std::size_t>(frame.workers);
  const std::size_t tiles = static_cast<std::size_t>(frame.tiles_x) * static_cast<std::size_t>(frame.tiles_y);
  std::uint32_t* const cursors = cursors_.reserve(segments * tiles);
  const auto begin = [&](std::size_t segment) { return drawn * segment / segments; };
  const int tiles_x = frame.tiles_x;

  parallel_for(segments, [&](std::size_t s) {
    std::uint32_t* const counts = cursors + s * tiles;
    std::fill(counts, counts + tiles, 0u);
    for (std::size_t i = begin(s); i < begin(s + 1); i++)
      for_tiles(frame.rects[row_of(order[i])], tiles_x, [&](int tile) { counts[tile]++; });
  });

  frame.tile_starts = starts_.reserve(tiles + 1);
  std::uint32_t sum = 0;
  for (std::size_t tile = 0; tile < tiles; tile++) {
    frame.tile_starts[tile] = sum;
    for (std::size_t s = 0; s < segments; s++) sum += std::exchange(cursors[s * tiles + tile], sum);
  }
  frame.tile_starts[tiles] = sum;

  std::uint64_t* const entries = frame.entries = entries_.reserve(sum);
  parallel_for(segments, [&](std::size_t s) {
    std::uint32_t* const cursor = cursors + s * tiles;
    for (std::size_t i = begin(s); i < begin(s + 1); i++) {
      const std::uint32_t row = row_of(order[i]);
      std::uint64_t slot = frame.pieces[row / ROWS_PER_PIECE].first_slot + frame.slots_of[row];
      for_tiles(frame.rects[row], tiles_x, [&](int tile) { entries[cursor[tile]++] = slot++ << 32 | row; });
    }
  });

  // Longest first: the last tile to be blended should be a short one.
  frame.tile_order = tile_order_.reserve(tiles);
  std::iota(frame.tile_order, frame.tile_order + tiles, 0u);
  const std::uint32_t* const starts = frame.tile_starts;
  std::stable_sort(frame.tile_order, frame.tile_order + tiles, [&](std::uint32_t a, std::uint32_t b) {
    return starts[a + 1] - starts[a] > starts[b + 1] - starts[b];
  });
}

}  // namespace ringlight
