// What opacities that change with the direction have in common.
#pragma once
#include "step/sh_block.isa.hpp"
#include "step/sh_rows.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

using Coefficients = Lanes[LANES];  // of one channel, at most HARMONICS

// Adds dL/d(mean position), of a sum of harmonics whose gradient is `by_sum`: only what is across the direction moves
// it, the less the farther away.
inline void add_to_means(const Lanes by_sum, int degree, const Block& block, const Coefficients& coefficients,
                         float* means) {
  if (degree == 0) return;  // the same from everywhere
  Lanes by_direction[3], by_means[3];
  direction_slope<1>(degree, block, coefficients, by_direction);
  load_triples(means, block, by_means);
  for (int i = 0; i < LANES; i++) {
    const float x = block.x[i], y = block.y[i], z = block.z[i], scale = block.inverse_distance[i] * by_sum[i];
    const float along = x * by_direction[0][i] + y * by_direction[1][i] + z * by_direction[2][i];
    by_means[0][i] += scale * (by_direction[0][i] - x * along);
    by_means[1][i] += scale * (by_direction[1][i] - y * along);
    by_means[2][i] += scale * (by_direction[2][i] - z * along);
  }
  store_triples(by_means, block, means);
}

inline bool is_zero(const float* upstream) {
  bool zero = true;
  for (int i = 0; i < LANES; i++) zero &= upstream[i] == 0;
  return zero;
}

}  // namespace
}  // namespace ringlight::RINGLIGHT_ISA
