// Rows of coefficients as planar rows, and how a sum of harmonics moves with the direction.
#pragma once
#include "step/sh_block.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

// Lines of a row are read out of order, which the processor does not foresee. Harmless past the end of the table.
inline void prefetch_block(const float* rows, int stored) {
  constexpr int LINE = 16;  // floats
  for (int i = 0; i < stored * LANES; i += LINE) __builtin_prefetch(rows + i);
}

// planar[k][lane] = rows[lane][k] for at least the first `count` coefficients of `stored`.
inline void to_planar(const float* rows, int stored, int count, Lanes* planar) {
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

// The first `count` coefficients of the block's rows of the table, turned into one planar row per coefficient.
inline void load_coefficients(const Harmonics& table, const Block& block, int count, Lanes* coefficients) {
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
  to_planar(rows, stored, count, coefficients);
}

// d(sum of w[CHANNELS k] basis[k]) / d(direction), by the derivatives of the polynomials in find_basis. One channel's
// coefficients lie CHANNELS planar rows apart.
template <int CHANNELS>
void direction_slope(int degree, const Block& block, const Lanes* coefficients, Lanes* by_direction) {
  const auto w = [coefficients](int k) { return coefficients[CHANNELS * k]; };
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

}  // namespace
}  // namespace ringlight::RINGLIGHT_ISA
