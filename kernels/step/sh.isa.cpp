// Colours from spherical harmonics, and how they move with the Gaussian: what the backward pass needs of the
// coefficients, so that it never reads them again.
#include "step/sh.hpp"

#include "machine/parallel.hpp"
#include "step/sh_block.isa.hpp"
#include "step/sh_mix.isa.hpp"
#include "step/sh_rows.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

constexpr std::size_t GRAIN = 64 * LANES;  // rows a piece: 200 KB of degree 3, half of a usual L2
constexpr float CLAMPED = -0.0f;           // a colour below black: shows as 0, and tells the backward pass

using Coefficients = Lanes[SH_REST];

void sum_harmonics(const Harmonics& table, const Block& block, const Lanes* coefficients, Lanes* sums) {
  Lanes constant[3];
  load_triples(table.constant, block, constant);
  for (int c = 0; c < 3; c++) {
    Lanes sum;
    if (table.by_logits) store(sum, sigmoid(load(constant[c])));
    else
      for (int i = 0; i < LANES; i++) sum[i] = GREY + C0 * constant[c][i];
    for (int k = 0; k < block.count; k++)
      for (int i = 0; i < LANES; i++) sum[i] += block.basis[k][i] * coefficients[3 * k + c][i];
    for (int i = 0; i < LANES; i++) sums[c][i] = sum[i];
  }
}

// d(colour) / d(mean), [9][LANES]. Through the normalization: only what is across the direction moves it, the less the
// farther away.
void find_slopes(int degree, const Block& block, const Lanes* coefficients, float* slopes) {
  if (degree == 0) {
    for (int i = 0; i < SH_SLOPES * LANES; i++) slopes[i] = 0;
    return;
  }
  for (int c = 0; c < 3; c++) {
    Lanes by_direction[3];
    direction_slope<3>(degree, block, coefficients + c, by_direction);
    float* const to = slopes + 3 * c * LANES;
    for (int i = 0; i < LANES; i++) {
      const float x = block.x[i], y = block.y[i], z = block.z[i], scale = block.inverse_distance[i];
      const float along = x * by_direction[0][i] + y * by_direction[1][i] + z * by_direction[2][i];
      to[i] = scale * (by_direction[0][i] - x * along);
      to[LANES + i] = scale * (by_direction[1][i] - y * along);
      to[2 * LANES + i] = scale * (by_direction[2][i] - z * along);
    }
  }
}

void differentiate_block(const HarmonicsUpstream& from, const HarmonicsGradient& to, const Block& block) {
  Lanes colors[3], upstream[3], by_sum[3], by_constant[3], by_means[3];
  load_triples(from.colors, block, colors);
  load_triples(from.upstream, block, upstream);
  if (to.adds) load_triples(to.means, block, by_means);
  for (int c = 0; c < 3; c++)
    for (int i = 0; i < LANES; i++) {
      // Nothing passes where the colour was clamped at black, nor where it is not a number.
      const bool passes = colors[c][i] >= 0 && !__builtin_signbit(colors[c][i]);
      by_sum[c][i] = passes ? upstream[c][i] : 0.0f;
      by_constant[c][i] = C0 * by_sum[c][i];
    }
  store_triples(by_constant, block, to.constant);
  const float* const slopes = from.slopes + block.first * SH_SLOPES;
  for (int axis = 0; axis < 3; axis++)
    for (int i = 0; i < LANES; i++) {
      const float *s = slopes + axis * LANES + i, before = to.adds ? by_means[axis][i] : 0.0f;
      by_means[axis][i] = before + (s[0] * by_sum[0][i] + s[3 * LANES] * by_sum[1][i] + s[6 * LANES] * by_sum[2][i]);
    }
  store_triples(by_means, block, to.means);
}

// `fill(block, coefficients)` writes the coefficients of a block's rows, planar.
template <class Fill>
void colors_of(const Harmonics& table, float* colors, float* slopes, Fill fill) {
  parallel_ranges(table.count, GRAIN, [&](std::size_t begin, std::size_t end) {
    Block block;
    alignas(64) Coefficients coefficients;
    for (std::size_t first = begin; first < end; first += LANES) {
      open_block(table, first, end, block);
      if (block.count > 0) fill(block, coefficients);
      Lanes sums[3];
      sum_harmonics(table, block, coefficients, sums);
      for (int c = 0; c < 3; c++)
        for (int i = 0; i < LANES; i++) sums[c][i] = sums[c][i] < 0 ? CLAMPED : sums[c][i];  // NaN stays
      store_triples(sums, block, colors);
      if (slopes) find_slopes(table.degree, block, coefficients, slopes + first * SH_SLOPES);
    }
  });
}

}  // namespace

void sh_colors(const Harmonics& table, float* colors, float* slopes) {
  colors_of(table, colors, slopes, [&](const Block& block, Lanes* coefficients) __attribute__((always_inline)) {
    load_coefficients(table, block, 3 * block.count, coefficients);
  });
}

void sh_basis_colors(const Harmonics& table, const SharedBasis& mixed, float* colors, float* slopes) {
  colors_of(table, colors, slopes, [&](const Block& block, Lanes* coefficients) __attribute__((always_inline)) {
    mix_coefficients(mixed, block, coefficients);
  });
}

void sh_gradient(const HarmonicsUpstream& from, const HarmonicsGradient& to) {
  parallel_ranges(from.count, GRAIN, [&](std::size_t begin, std::size_t end) {
    Block block;
    for (block.first = begin; block.first < end; block.first += LANES) {
      block.rows = end - block.first < LANES ? static_cast<int>(end - block.first) : LANES;
      differentiate_block(from, to, block);
    }
  });
}

}  // namespace ringlight::RINGLIGHT_ISA
