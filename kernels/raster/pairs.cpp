#include "raster/pairs.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "machine/parallel.hpp"

namespace ringlight {
namespace {

// A block of 4 x 4 pixels: its corner, and how many of its columns and rows lie in the image.
struct Block {
  int left, top, columns, rows;
};

Block block_at(const View& view, int number, int block) {
  constexpr int SIDE = convention::TILE / convention::BLOCK;
  const int left = number % view.tiles_x * convention::TILE + convention::BLOCK * (block % SIDE);
  const int top = number / view.tiles_x * convention::TILE + convention::BLOCK * (block / SIDE);
  return {left, top, view.camera.width - left, view.camera.height - top};
}

// One entry at the pixels of one block, whose transmittances it lowers. Returns the pixels of the image that it added
// to. `finished` when no lane is left for those behind: the kernels walk on for lanes beyond the border too.
int blend_block(const float* record, const Block& block, float strongest, float* transmittance, bool& finished) {
  int added = 0;
  bool unfinished = false;
  for (int lane = 0; lane < LANES; lane++) {
    const int column = lane % convention::BLOCK, row = lane / convention::BLOCK;
    const float dx = static_cast<float>(block.left + column) + 0.5f - record[CENTER_X];
    const float dy = static_cast<float>(block.top + row) + 0.5f - record[CENTER_Y];
    const float along = record[ALONG_X] * dx + record[ALONG_Y] * dy, across = record[ACROSS_Y] * dy;
    const float log2_alpha = record[LOG2_OPACITY] - along * along - across * across;
    const bool seen = log2_alpha >= LOG2_MIN_ALPHA;
    if (seen) transmittance[lane] *= 1 - std::min(std::exp2(log2_alpha), strongest);
    if (!(transmittance[lane] > convention::MIN_TRANSMITTANCE)) continue;
    unfinished = true;
    added += seen && column < block.columns && row < block.rows;
  }
  finished = !unfinished;
  return added;
}

PairCounts count_tile(const View& view, int number) {
  float transmittance[BLOCKS][LANES];
  std::fill_n(transmittance[0], BLOCKS * LANES, 1.f);
  PairCounts counts{0, 0};
  std::uint64_t alive = ~std::uint64_t{0};
  const std::uint32_t begin = view.tile_starts[number], end = begin + view.tile_used[number];
  for (std::uint32_t at = begin; at < end; at++) {
    const float* const record = view.records + std::size_t{static_cast<std::uint32_t>(view.entries[at])} * RECORD;
    for (std::uint64_t blocks = view.block_masks[at] & alive; blocks; blocks &= blocks - 1) {
      const int block = __builtin_ctzll(blocks);
      bool finished;
      counts.blended += blend_block(record, block_at(view, number, block), view.settings.max_alpha,
                                    transmittance[block], finished);
      counts.evaluated += LANES;
      if (finished) alive &= ~(std::uint64_t{1} << block);
    }
  }
  return counts;
}

}  // namespace

PairCounts count_pairs(const View& view) {
  std::vector<PairCounts> tiles(static_cast<std::size_t>(view.tile_count));
  parallel_for(tiles.size(),
               [&](std::size_t i) { tiles[i] = count_tile(view, static_cast<int>(view.tile_order[i])); });
  PairCounts total{0, 0};
  for (const PairCounts& tile : tiles) {
    total.evaluated += tile.evaluated;
    total.blended += tile.blended;
  }
  return total;
}

}  // namespace ringlight
