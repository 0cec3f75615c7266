// Directions from the camera and the harmonics' polynomials in them, LANES Gaussians at a time: each quantity of theirs
// is one planar row of floats.
#pragma once
#include "convention.hpp"
#include "simd/simd.isa.hpp"
#include "step/sh.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

using namespace convention;  // norms of the polynomials below

constexpr float SMALLEST_SQUARE = SMALLEST_LENGTH * SMALLEST_LENGTH;
constexpr int HARMONICS = 15;  // without the constant one

using Lanes = float[LANES];

struct Block {
  std::size_t first;  // row of the table
  int rows;           // LANES except at the end of the table; surplus lanes repeat the last row
  int count;          // harmonics in use, without the constant one
  Lanes x, y, z;      // unit directions from the camera
  Lanes inverse_distance;
  Lanes basis[HARMONICS];
};

// Harmonics up to `degree`, without the constant one.
constexpr int harmonics_of(int degree) { return (degree + 1) * (degree + 1) - 1; }

// First of the sixteen coefficients of a row that are turned together: the last sixteen are pulled back, so that they
// end with the row, and repeat some work instead of touching the next row.
inline int piece_start(int coefficient, int stored) {
  if (stored < LANES) return 0;
  return coefficient + LANES <= stored ? coefficient : stored - LANES;
}

// Three planar rows from the block's rows of a table [N 3].
inline void load_triples(const float* table, const Block& block, Lanes* planar) {
  const float* const from = table + 3 * block.first;
  if (block.rows == LANES) {
    Vec a(0.f), b(0.f), c(0.f);
    load_columns(from, a, b, c);
    store(planar[0], a);
    store(planar[1], b);
    store(planar[2], c);
    return;
  }
  for (int lane = 0; lane < LANES; lane++)
    for (int k = 0; k < 3; k++) planar[k][lane] = from[3 * (lane < block.rows ? lane : block.rows - 1) + k];
}

// And back.
inline void store_triples(const Lanes* planar, const Block& block, float* table) {
  float* const to = table + 3 * block.first;
  if (block.rows == LANES) return store_columns(to, load(planar[0]), load(planar[1]), load(planar[2]));
  for (int lane = 0; lane < block.rows; lane++)
    for (int k = 0; k < 3; k++) to[3 * lane + k] = planar[k][lane];
}

inline void find_directions(const Harmonics& table, Block& block) {
  Lanes means[3];
  load_triples(table.means, block, means);
  for (int i = 0; i < LANES; i++) {
    block.x[i] = means[0][i] - table.position[0];
    block.y[i] = means[1][i] - table.position[1];
    block.z[i] = means[2][i] - table.position[2];
  }
  for (int i = 0; i < LANES; i++) {
    const float square = block.x[i] * block.x[i] + block.y[i] * block.y[i] + block.z[i] * block.z[i];
    const float inverse = 1 / __builtin_sqrtf(square > SMALLEST_SQUARE ? square : SMALLEST_SQUARE);
    block.inverse_distance[i] = inverse;
    block.x[i] *= inverse;
    block.y[i] *= inverse;
    block.z[i] *= inverse;
  }
}

inline void find_basis(int degree, Block& block) {
  Lanes* basis = block.basis;
  if (degree >= 1)
    for (int i = 0; i < LANES; i++) {
      basis[0][i] = -C1 * block.y[i];
      basis[1][i] = C1 * block.z[i];
      basis[2][i] = -C1 * block.x[i];
    }
  if (degree >= 2)
    for (int i = 0; i < LANES; i++) {
      const float x = block.x[i], y = block.y[i], z = block.z[i];
      basis[3][i] = C2[1] * x * y;
      basis[4][i] = -C2[1] * y * z;
      basis[5][i] = C2[0] * (2 * z * z - x * x - y * y);
      basis[6][i] = -C2[1] * x * z;
      basis[7][i] = C2[2] * (x * x - y * y);
    }
  if (degree >= 3)
    for (int i = 0; i < LANES; i++) {
      const float x = block.x[i], y = block.y[i], z = block.z[i];
      const float xx = x * x, yy = y * y, zz = z * z;
      basis[8][i] = -C3[3] * y * (3 * xx - yy);
      basis[9][i] = 2 * C3[2] * x * y * z;
      basis[10][i] = -C3[1] * y * (4 * zz - xx - yy);
      basis[11][i] = C3[0] * z * (2 * zz - 3 * xx - 3 * yy);
      basis[12][i] = -C3[1] * x * (4 * zz - xx - yy);
      basis[13][i] = C3[2] * z * (xx - yy);
      basis[14][i] = -C3[3] * x * (xx - 3 * yy);
    }
}

// The block of rows from `first` on, of a table whose piece ends at `end`.
inline void open_block(const Harmonics& table, std::size_t first, std::size_t end, Block& block) {
  block.first = first;
  block.rows = end - first < LANES ? static_cast<int>(end - first) : LANES;
  block.count = harmonics_of(table.degree);
  find_directions(table, block);
  find_basis(table.degree, block);
}

}  // namespace
}  // namespace ringlight::RINGLIGHT_ISA
