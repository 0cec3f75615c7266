// Counting sort by tile in two sweeps over the depth-sorted list. Each worker takes a consecutive part of it and has
// its own cursor in every tile, behind those of the parts in front: entries of a tile stay in depth order.
#include "raster/bin.hpp"

#include <algorithm>
#include <numeric>
#include <utility>

#include "machine/parallel.hpp"
#include "raster/sort.hpp"

namespace ringlight {
namespace {

constexpr std::size_t PREFETCH = 16;  // rows ahead

// Calls visit(tile number) for the tiles of a placement that is not 2 x 2, in row-major order.
template <class Visit>
void for_listed_tiles(const Placement& place, int tiles_x, Visit&& visit) {
  std::uint32_t tiles = place.tiles;
  const bool every = tiles == EVERY_TILE;
  for (int y = place.y0; y <= place.y1; y++)
    for (int x = place.x0; x <= place.x1; x++, tiles >>= 1)
      if (every || (tiles & 1)) visit(y * tiles_x + x);
}

// The 2 x 2 case has no branches: which tiles are touched cannot be predicted. A tile that is not touched counts 0,
// and its entry goes to a place that nobody reads.
class Dealer {
 public:
  Dealer(const View& view, const std::uint64_t* order, std::size_t drawn)
      : placements_(view.placements), pieces_(view.pieces), order_(order), drawn_(drawn), tiles_x_(view.tiles_x) {}

  void count(std::size_t begin, std::size_t end, std::uint32_t* counts) const {
    for (std::size_t i = begin; i < end; i++) {
      const Placement& place = at(i);
      if (place.tiles & LISTED) [[unlikely]] {
        for_listed_tiles(place, tiles_x_, [&](int tile) { counts[tile]++; });
        continue;
      }
      std::uint32_t* const corner = counts + place.y0 * tiles_x_ + place.x0;
      corner[0] += place.tiles & 1;
      corner[1] += place.tiles >> 1 & 1;
      corner[tiles_x_] += place.tiles >> 2 & 1;
      corner[tiles_x_ + 1] += place.tiles >> 3 & 1;
    }
  }

  void deal(std::size_t begin, std::size_t end, std::uint32_t* cursors, std::uint64_t* entries,
            std::uint32_t nowhere) const {
    for (std::size_t i = begin; i < end; i++) {
      const Placement& place = at(i);
      const std::uint32_t row = row_of(order_[i]);
      std::uint64_t entry = (pieces_[row / ROWS_PER_PIECE].first_slot + place.first_slot) << 32 | row;
      constexpr std::uint64_t NEXT_SLOT = std::uint64_t{1} << 32;
      if (place.tiles & LISTED) [[unlikely]] {
        for_listed_tiles(place, tiles_x_, [&](int tile) {
          entries[cursors[tile]++] = entry;
          entry += NEXT_SLOT;
        });
        continue;
      }
      std::uint32_t* const corner = cursors + place.y0 * tiles_x_ + place.x0;
      const std::uint32_t corners[4] = {0, 1, static_cast<std::uint32_t>(tiles_x_),
                                        static_cast<std::uint32_t>(tiles_x_) + 1};
      for (int k = 0; k < 4; k++) {
        const std::uint32_t touched = place.tiles >> k & 1;
        std::uint32_t& cursor = corner[corners[k]];
        entries[nowhere + (cursor - nowhere) * touched] = entry;
        cursor += touched;
        entry += touched * NEXT_SLOT;
      }
    }
  }

 private:
  const Placement& at(std::size_t i) const {
    if (i + PREFETCH < drawn_) __builtin_prefetch(placements_ + row_of(order_[i + PREFETCH]));
    return placements_[row_of(order_[i])];
  }

  const Placement* placements_;
  const Piece* pieces_;
  const std::uint64_t* order_;
  std::size_t drawn_;
  int tiles_x_;
};

}  // namespace

void Binning::bin(View& view, const std::uint64_t* order, std::size_t drawn) {
  const Dealer dealer(view, order, drawn);
  const std::size_t segments = static_cast<std::size_t>(view.workers);
  const std::size_t tiles = static_cast<std::size_t>(view.tiles_x) * static_cast<std::size_t>(view.tiles_y);
  // A 2 x 2 placement at the right or lower edge reaches past it: those cells are read, and stay as they are.
  const std::size_t stride = tiles + static_cast<std::size_t>(view.tiles_x) + 1;
  std::uint32_t* const cursors = cursors_.reserve(segments * stride);
  const auto begin = [&](std::size_t segment) { return drawn * segment / segments; };

  parallel_for(segments, [&](std::size_t s) {
    std::fill(cursors + s * stride, cursors + (s + 1) * stride, 0u);
    dealer.count(begin(s), begin(s + 1), cursors + s * stride);
  });

  view.tile_starts = starts_.reserve(tiles + 1);
  std::uint32_t sum = 0;
  for (std::size_t tile = 0; tile < tiles; tile++) {
    view.tile_starts[tile] = sum;
    for (std::size_t s = 0; s < segments; s++) sum += std::exchange(cursors[s * stride + tile], sum);
  }
  view.tile_starts[tiles] = sum;

  constexpr std::size_t CACHE_LINE = 8;  // entries; each worker has its own nowhere
  std::uint64_t* const entries = view.entries = entries_.reserve(sum + (segments + 1) * CACHE_LINE);
  parallel_for(segments, [&](std::size_t s) {
    const auto nowhere = static_cast<std::uint32_t>(sum + (s + 1) * CACHE_LINE);
    dealer.deal(begin(s), begin(s + 1), cursors + s * stride, entries, nowhere);
  });

  // Longest first: the last tile to be blended should be a short one.
  view.tile_count = static_cast<int>(tiles);
  view.tile_order = tile_order_.reserve(tiles);
  std::iota(view.tile_order, view.tile_order + tiles, 0u);
  const std::uint32_t* const starts = view.tile_starts;
  std::stable_sort(view.tile_order, view.tile_order + tiles, [&](std::uint32_t a, std::uint32_t b) {
    return starts[a + 1] - starts[a] > starts[b + 1] - starts[b];
  });
}

}  // namespace ringlight
