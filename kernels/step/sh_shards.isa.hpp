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

// `to` [width]: the sums [shards, width, LANES], in order.
inline void add_shards(const float* sums, std::size_t shards, std::size_t width, float* to) {
  for (std::size_t i = 0; i < width; i++) {
    float sum = 0;
    for (std::size_t shard = 0; shard < shards; shard++)
      for (int lane = 0; lane < LANES; lane++) sum += sums[(shard * width + i) * LANES + lane];
    to[i] = sum;
  }
}

}  // namespace
}  // namespace ringlight::RINGLIGHT_ISA
