// Colours from spherical harmonics, and how they move with the Gaussian: what the backward pass needs of the
// coefficients, so that it never reads them again.
#include "step/sh.hpp"

#include "machine/parallel.hpp"
#include "step/sh_block.isa.hpp"
#include "step/sh_mix.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

constexpr std::size_t GRAIN = 64 * LANES;  // rows a piece: 200 KB of degree 3, half of a usual L2
constexpr float CLAMPED = -0.0f;           // a colour below black: shows as 0, and tells the backward pass

using Coefficients = Lanes[SH_REST];

// Lines of a row are read out of order, which the processor does not foresee. Harmless past the end of the table.
void prefetch_block(const float* rows, int stored) {
  constexpr int LINE = 16;  // floats
  for (int i = 0; i < stored * LANES; i += LINE) __builtin_prefetch(rows + i);
}

// planar[k][lane] = rows[lane][k] for at least the first `count` coefficients of `stored`.
void to_planar(const float* rows, int stored, int count, Lanes* planar) {
  for (int first = 0; first < count; first += LANES) {
    const int start = piece_start(first, stored);
    Vec square[LANES];
    for (int lane = 0; lane < LANES; lane++) {
      const float* const from = rows + stored * lane + start;
      square[lane] = stored < LANES ? load_first(from, stored) : load(from);
    }
    transpose(square);
    for (int k = 0; k < LANES; k++) store(planar[start + k], square[k]);
  }
}

// The table's rows of coefficients, turned into one planar row per coefficient.
void load_coefficients(const Harmonics& table, const Block& block, Lanes* coefficients) {
  const int stored = table.stored;
  const float* rows = table.rest + static_cast<std::size_t>(stored) * block.first;
  prefetch_block(rows + stored * LANES, stored);
  float tail[LANES * SH_REST];
  if (block.rows < LANES) {
    for (int lane = 0; lane < LANES; lane++) {
      const int row = lane < block.rows ? lane : block.rows - 1;
      for (int k = 0; k < stored; k++) tail[stored * lane + k] = rows[stored * row + k];
    }
    rows = tail;
  }
  to_planar(rows, stored, 3 * block.count, coefficients);
}

void sum_harmonics(const Harmonics& table, const Block& block, const Lanes* coefficients, Lanes* sums) {
  Lanes constant[3];
  load_triples(table.constant, block, constant);
  for (int c = 0; c < 3; c++) {
    Lanes sum;
    for (int i = 0; i < LANES; i++) sum[i] = GREY + C0 * constant[c][i];
    for (int k = 0; k < block.count; k++)
      for (int i = 0; i < LANES; i++) sum[i] += block.basis[k][i] * coefficients[3 * k + c][i];
    for (int i = 0; i < LANES; i++) sums[c][i] = sum[i];
  }
}

// d(sum of w[3 k] basis[k]) / d(direction), by the derivatives of the polynomials in find_basis. One colour's
// coefficients lie three planar rows apart.
void direction_slope(int degree, const Block& block, const Lanes* coefficients, Lanes* by_direction) {
  const auto w = [coefficients](int k) { return coefficients[3 * k]; };
  Lanes &gx = by_direction[0], &gy = by_direction[1], &gz = by_direction[2];
  for (int i = 0; i < LANES; i++) {
    gx[i] = -C1 * w(2)[i];
    gy[i] = -C1 * w(0)[i];
    gz[i] = C1 * w(1)[i];
  }
  if (degree >= 2)
    for (int i = 0; i < LANES; i++) {
      const float x = block.x[i], y = block.y[i], z = block.z[i];
      gx[i] += C2[1] * (y * w(3)[i] - z * w(6)[i]) + 2 * x * (C2[2] * w(7)[i] - C2[0] * w(5)[i]);
      gy[i] += C2[1] * (x * w(3)[i] - z * w(4)[i]) - 2 * y * (C2[2] * w(7)[i] + C2[0] * w(5)[i]);
      gz[i] += 4 * C2[0] * z * w(5)[i] - C2[1] * (y * w(4)[i] + x * w(6)[i]);
    }
  if (degree >= 3)
    for (int i = 0; i < LANES; i++) {
      const float x = block.x[i], y = block.y[i], z = block.z[i];
      const float xx = x * x, yy = y * y, zz = z * z, xy = x * y, xz = x * z, yz = y * z;
      gx[i] += C3[3] * (-6 * xy * w(8)[i] - 3 * (xx - yy) * w(14)[i]) + 2 * C3[2] * (yz * w(9)[i] + xz * w(13)[i]) +
               C3[1] * (2 * xy * w(10)[i] - (4 * zz - 3 * xx - yy) * w(12)[i]) - 6 * C3[0] * xz * w(11)[i];
      gy[i] += C3[3] * (6 * xy * w(14)[i] - 3 * (xx - yy) * w(8)[i]) + 2 * C3[2] * (xz * w(9)[i] - yz * w(13)[i]) +
               C3[1] * (2 * xy * w(12)[i] - (4 * zz - xx - 3 * yy) * w(10)[i]) - 6 * C3[0] * yz * w(11)[i];
      gz[i] += C3[2] * (2 * xy * w(9)[i] + (xx - yy) * w(13)[i]) - 8 * C3[1] * (yz * w(10)[i] + xz * w(12)[i]) +
               3 * C3[0] * (2 * zz - xx - yy) * w(11)[i];
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
    direction_slope(degree, block, coefficients + c, by_direction);
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
    load_coefficients(table, block, coefficients);
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
