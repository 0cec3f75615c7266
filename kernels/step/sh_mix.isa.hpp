// Coefficients of a block of Gaussians as a mix of shared ones.
#pragma once
#include "simd/row_columns.isa.hpp"
#include "step/sh_block.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

static_assert(convention::SH_MAX_BASIS <= LANES, "a row of weights is one Vec");
constexpr int TOGETHER = 9;
static_assert(SH_REST % TOGETHER == 0);

// [K][LANES], the block's rows of weights[N][K].
inline void load_weights(const SharedBasis& mixed, const Block& block, Lanes* weights) {
  const int count = mixed.count;
  Vec columns[LANES];
  take_columns(mixed.weights + static_cast<std::size_t>(count) * block.first, count, block.rows, columns);
  for (int j = 0; j < count; j++) store(weights[j], columns[j]);
}

// For the harmonics that are in use.
inline void mix_coefficients(const SharedBasis& mixed, const Block& block, Lanes* coefficients) {
  alignas(64) Lanes weights[convention::SH_MAX_BASIS];
  load_weights(mixed, block, weights);
  const int count = mixed.count;
  // A sum waits for the one before it, nine do not wait for each other. At degree 2 the last nine reach into the next
  // degree, which is there in every basis, and is not used.
  for (int first = 0; first < 3 * block.count; first += TOGETHER) {
    Vec sums[TOGETHER];
    for (int j = 0; j < count; j++) {
      const Vec weight = load(weights[j]);
      const float* const basis = mixed.basis + SH_REST * j + first;
      for (int k = 0; k < TOGETHER; k++) sums[k] = j ? fma(weight, Vec(basis[k]), sums[k]) : weight * Vec(basis[k]);
    }
    for (int k = 0; k < TOGETHER; k++) store(coefficients[first + k], sums[k]);
  }
}

}  // namespace
}  // namespace ringlight::RINGLIGHT_ISA
