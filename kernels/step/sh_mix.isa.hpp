// Coefficients of a block of Gaussians as a mix of shared ones.
#pragma once
#include "simd/row_columns.isa.hpp"
#include "step/sh_block.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

static_assert(convention::SH_MAX_BASIS <= LANES, "a row of weights is one Vec");

// Sums that are taken at once: one waits for the one before it, several do not wait for each other. As many as stay in
// the registers of AVX2, and of AVX-512 where those are four times as many; more opacities were not tried there.
constexpr int COLORS_TOGETHER = VEC_REGISTERS >= 32 ? 9 : 5, OPACITIES_TOGETHER = 5;
static_assert(SH_REST % COLORS_TOGETHER == 0 && HARMONICS % OPACITIES_TOGETHER == 0);

// [K][LANES], the block's rows of weights[N][K].
inline void load_weights(const SharedBasis& mixed, const Block& block, Lanes* weights) {
  const int count = mixed.count;
  Vec columns[LANES];
  take_columns(mixed.weights + static_cast<std::size_t>(count) * block.first, count, block.rows, columns);
  for (int j = 0; j < count; j++) store(weights[j], columns[j]);
}

// coefficients[k] = sum of weights[j] basis[j][k] for k < used, of a basis with `stored` numbers a row. The last ones
// together reach into the next degree, which is there in every basis, and is not used.
template <int Together>
inline void mix(const SharedBasis& mixed, const Lanes* weights, int used, int stored, Lanes* coefficients) {
  for (int first = 0; first < used; first += Together) {
    Vec sums[Together];
#pragma GCC unroll 9
    for (int k = 0; k < Together; k++) sums[k] = Vec(0.f);
    for (int j = 0; j < mixed.count; j++) {
      const Vec weight = load(weights[j]);
      const float* const basis = mixed.basis + stored * j + first;
#pragma GCC unroll 9
      for (int k = 0; k < Together; k++) sums[k] = fma(weight, Vec(basis[k]), sums[k]);
    }
#pragma GCC unroll 9
    for (int k = 0; k < Together; k++) store(coefficients[first + k], sums[k]);
  }
}

// Of colours, for the harmonics that are in use.
inline void mix_coefficients(const SharedBasis& mixed, const Block& block, Lanes* coefficients) {
  alignas(64) Lanes weights[SH_MAX_BASIS];
  load_weights(mixed, block, weights);
  mix<COLORS_TOGETHER>(mixed, weights, 3 * block.count, SH_REST, coefficients);
}

}  // namespace
}  // namespace ringlight::RINGLIGHT_ISA
