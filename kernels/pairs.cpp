#include "pairs.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "parallel.hpp"

namespace ringlight {
namespace {

// One entry at the pixels of one block, whose transmittances it lowers. Returns the pixels that it added to, and closes
// the block when there is none left for those behind.
int blend_block(const float* record, float left, float top, float strongest, float* transmittance, bool& closed) {
  int added = 0;
  bool unfinished = false;
  for (int lane = 0; lane < LANES; lane++) {
    const float dx = left + static_cast<float>(lane % 4) + 0.5f - record[CENTER_X];
    const float dy = top + static_cast<float>(lane / 4) + 0.5f - record[CENTER_Y];
    const float along = record[ALONG_X] * dx + record[ALONG_Y] * dy, across = record[ACROSS_Y] * dy;
    const float log2_alpha = record[LOG2_OPACITY] - along * along - across * across;
    const bool seen = log2_alpha >= LOG2_MIN_ALPHA;
    if (seen) transmittance[lane] *= 1 - std::min(std::exp2(log2_alpha), strongest);
    if (!(transmittance[lane] > convention::MIN_TRANSMITTANCE)) continue;
    unfinished = true;
    added += seen;
  }
  closed = !unfinished;
  return added;
}

PairCounts count_tile(const Frame& frame, int number) {
  constexpr int SIDE = convention::TILE / convention::BLOCK;
  const float left = static_cast<float>(number % frame.tiles_x * convention::TILE);
  const float top = static_cast<float>(number / frame.tiles_x * convention::TILE);
  float transmittance[BLOCKS][LANES];
  std::fill_n(transmittance[0], BLOCKS * LANES, 1.f);
  PairCounts counts{0, 0};
  std::uint64_t alive = ~std::uint64_t{0};
  const std::uint32_t begin = frame.tile_starts[number], end = begin + frame.tile_used[number];
  for (std::uint32_t at = begin; at < end; at++) {
    const float* const record = frame.records + std::size_t{static_cast<std::uint32_t>(frame.entries[at])} * RECORD;
    for (std::uint64_t blocks = frame.block_masks[at] & alive; blocks; blocks &= blocks - 1) {
      const int block = __builtin_ctzll(blocks);
      const float x = left + static_cast<float>(convention::BLOCK * (block % SIDE));
      const float y = top + static_cast<float>(convention::BLOCK * (block / SIDE));
      bool closed;
      counts.blended += blend_block(record, x, y, frame.settings.max_alpha, transmittance[block], closed);
      counts.evaluated += LANES;
      if (closed) alive &= ~(std::uint64_t{1} << block);
    }
  }
  return counts;
}

}  // namespace

PairCounts count_pairs(const Frame& frame) {
  std::vector<PairCounts> tiles(static_cast<std::size_t>(frame.tiles_x) * static_cast<std::size_t>(frame.tiles_y));
  parallel_for(tiles.size(), [&](std::size_t tile) { tiles[tile] = count_tile(frame, static_cast<int>(tile)); });
  PairCounts total{0, 0};
  for (const PairCounts& tile : tiles) {
    total.evaluated += tile.evaluated;
    total.blended += tile.blended;
  }
  return total;
}

}  // namespace ringlight
