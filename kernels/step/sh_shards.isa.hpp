// Sums over all Gaussians of what they share, in a fixed number of shards: the same bits for any number of threads.
#pragma once
#include <cstddef>

#include "simd/simd.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

// Each shard has sums of its own, 23 KB of eight functions, so that few blocks have few shards. A function of the
// number of blocks alone: the order of summation must not depend on the machine.
constexpr std::size_t BLOCKS_PER_SHARD = 256, MOST_SHARDS = 16;

inline std::size_t shards_of(std::size_t blocks) {
  const std::size_t shards = (blocks + BLOCKS_PER_SHARD - 1) / BLOCKS_PER_SHARD;
  return shards < 1 ? 1 : shards < MOST_SHARDS ? shards : MOST_SHARDS;
}

// Blocks in a row that one shard takes before it skips those of the others: enough that memory is read ahead, and few
// enough that neighbours, which are seen together, are shared out.
constexpr std::size_t BLOCKS_IN_A_ROW = 32;

// Calls each(row) for the first row of every block of a shard, of a table of `count` rows.
template <class Each>
inline void for_blocks_of(std::size_t shard, std::size_t shards, std::size_t count, Each each) {
  constexpr std::size_t ROWS = BLOCKS_IN_A_ROW * LANES;
  for (std::size_t begin = shard * ROWS; begin < count; begin += shards * ROWS) {
    const std::size_t end = begin + ROWS < count ? begin + ROWS : count;
    for (std::size_t row = begin; row < end; row += LANES) each(row);
  }
}

// `to` [width]: the sums [shards, width, LANES], in order.
inline void add_shards(const float* sums, std::size_t shards, std::size_t width, float* to) {
  for (std::size_t first = 0; first < width; first += LANES) {
    const int count = width - first < LANES ? static_cast<int>(width - first) : LANES;
    Vec terms[LANES];
    for (int i = 0; i < LANES; i++) {
      terms[i] = Vec(0.f);
      if (i >= count) continue;
      const float* const from = sums + (first + static_cast<std::size_t>(i)) * LANES;
      for (std::size_t shard = 0; shard < shards; shard++) terms[i] = terms[i] + load(from + shard * width * LANES);
    }
    store_first(to + first, lane_sums<LANES>(terms), count);
  }
}

}  // namespace
}  // namespace ringlight::RINGLIGHT_ISA
