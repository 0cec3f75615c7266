#include "horizon.hpp"

#include <algorithm>
#include <bit>
#include <limits>

#include "parallel.hpp"
#include "placement.hpp"

namespace ringlight {
namespace {

// Depth keys are smaller than the first and larger than the second.
constexpr std::uint32_t EVERYTHING = HIDDEN - 1, NOTHING = 0;

// Between two visits of a photograph Gaussians move and fade, so a tile may become opaque a little deeper than before.
// With a larger margin less is hidden, with a smaller one more tiles are blended twice.
constexpr float MARGIN = 1.05f;

// Where less than an eighth of the tiles have a horizon, to look for what they hide takes longer than to draw it.
constexpr std::size_t WORTH_A_LOOK = 8;

constexpr float UNKNOWN = std::numeric_limits<float>::infinity();

std::size_t tiles_of(const Frame& frame) {
  return static_cast<std::size_t>(frame.tiles_x) * static_cast<std::size_t>(frame.tiles_y);
}

std::uint32_t limit_at(float depth) {
  if (depth <= 0) return NOTHING;
  return depth < UNKNOWN ? std::bit_cast<std::uint32_t>(depth) : EVERYTHING;  // of NaN, too
}

// Without branches for the 2 x 2 case, as in bin.cpp: what is hidden cannot be predicted.
bool is_shown(const Placement& place, std::uint32_t key, const std::uint32_t* limits, int tiles_x) {
  bool shown = false;
  if (place.tiles & LISTED) [[unlikely]] {
    for_listed_tiles(place, tiles_x, [&](int tile) { shown |= key <= limits[tile]; });
    return shown;
  }
  const std::uint32_t* const corner = limits + place.y0 * tiles_x + place.x0;
  const std::uint32_t near_enough = static_cast<std::uint32_t>(key <= corner[0]) | (key <= corner[1]) << 1 |
                                    (key <= corner[tiles_x]) << 2 | (key <= corner[tiles_x + 1]) << 3;
  return place.tiles & near_enough;
}

// Marks the rows that no tile wants; returns the number of the others.
std::size_t mark_hidden(const Frame& frame) {
  const std::uint32_t* const limits = frame.horizon;
  const std::uint32_t nearest = *std::min_element(limits, limits + tiles_of(frame));
  parallel_ranges(frame.splats.count, ROWS_PER_PIECE, [&](std::size_t begin, std::size_t end) {
    std::uint32_t count = 0;
    for (std::size_t row = begin; row < end; row++) {
      Placement& place = frame.placements[row];
      if (place.depth_key == NOT_DRAWN) continue;
      const std::uint32_t key = place.depth_key & ~HIDDEN;
      const bool shown = key <= nearest || is_shown(place, key, limits, frame.tiles_x);
      place.depth_key = shown ? key : key | HIDDEN;
      count += shown;
    }
    frame.pieces[begin / ROWS_PER_PIECE].shown = count;
  });
  std::size_t shown = 0;
  for (std::size_t begin = 0; begin < frame.splats.count; begin += ROWS_PER_PIECE)
    shown += frame.pieces[begin / ROWS_PER_PIECE].shown;
  return shown;
}

}  // namespace

std::size_t Horizon::hide(Frame& frame, const float* depths, std::size_t drawn) {
  const std::size_t tiles = tiles_of(frame), margin = static_cast<std::size_t>(frame.tiles_x) + 1;
  std::uint32_t* const limits = limits_.reserve(tiles + margin);
  std::transform(depths, depths + tiles, limits, limit_at);
  const auto open = static_cast<std::size_t>(std::count(limits, limits + tiles, EVERYTHING));
  frame.horizon = nullptr;
  if ((tiles - open) * WORTH_A_LOOK < tiles) return drawn;
  std::fill_n(limits + tiles, margin, NOTHING);  // a 2 x 2 placement at the edge reaches there
  frame.horizon = limits;
  return mark_hidden(frame);
}

std::size_t Horizon::reopen(const Frame& frame) {
  if (!frame.horizon) return 0;
  std::uint32_t* const limits = limits_.data();
  bool any = false;
  for (std::size_t tile = 0; tile < tiles_of(frame); tile++) {
    const bool failed = frame.tile_open[tile] && limits[tile] < EVERYTHING;
    limits[tile] = failed ? EVERYTHING : NOTHING;
    if (failed) frame.tile_used[tile] = 0;
    any |= failed;
  }
  return any ? mark_hidden(frame) : 0;
}

void Horizon::remember(const Frame& frame, float* depths) {
  for (int i = 0; i < frame.tile_count; i++) {
    const std::uint32_t tile = frame.tile_order[i];
    if (frame.tile_open[tile]) {
      depths[tile] = UNKNOWN;
      continue;
    }
    const std::uint64_t last = frame.entries[frame.tile_starts[tile] + frame.tile_used[tile] - 1];
    const std::uint32_t key = frame.placements[static_cast<std::uint32_t>(last)].depth_key;
    depths[tile] = std::bit_cast<float>(key) * MARGIN;
  }
}

}  // namespace ringlight
