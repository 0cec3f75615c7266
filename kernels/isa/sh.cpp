#include "sh.hpp"

#include "parallel.hpp"
#include "simd.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

// LANES Gaussians at a time, each quantity of theirs one planar row of floats.
constexpr std::size_t GRAIN = 64 * LANES;  // rows a piece: 200 KB of coefficients, half of a usual L2
constexpr float SMALLEST_SQUARE = 1e-24f;  // square of core/directions.py's SMALLEST_LENGTH

// Norms of the polynomials below, as in core/sh_basis.py.
constexpr float GREY = 0.5f;
constexpr float C0 = 0.28209479177387814f;
constexpr float C1 = 0.4886025119029199f;
constexpr float C2[] = {0.31539156525252005f, 1.0925484305920792f, 0.5462742152960396f};
constexpr float C3[] = {0.3731763325901154f, 0.4570457994644658f, 1.445305721320277f, 0.5900435899266435f};

using Lanes = float[LANES];

struct Block {
  std::size_t first;  // row of the table
  int rows;           // LANES except at the end of the table; surplus lanes repeat the last row
  int count;          // harmonics in use, without the constant one
  Lanes x, y, z;      // unit directions from the camera
  Lanes inverse_distance;
  Lanes basis[15];
  alignas(64) float coefficients[SH_REST][LANES];
  Lanes sums[3];  // colour before it is clamped at black
};

void find_directions(const Harmonics& table, Block& block) {
  const float* means = table.means + 3 * block.first;
  for (int lane = 0; lane < LANES; lane++) {
    const int row = lane < block.rows ? lane : block.rows - 1;
    block.x[lane] = means[3 * row] - table.position[0];
    block.y[lane] = means[3 * row + 1] - table.position[1];
    block.z[lane] = means[3 * row + 2] - table.position[2];
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

void find_basis(int degree, Block& block) {
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

constexpr int FOR_READING = 0, FOR_WRITING = 1;  // __builtin_prefetch's second argument

// Rows are read and written in pieces of a line and out of order, which the processor does not foresee: without this
// the backward pass takes 1.7 times as long. Lines past the end of the table do no harm.
template <int intent>
void prefetch_block(const float* rows) {
  constexpr int LINE = 16;  // floats
  for (int i = 0; i < SH_REST * LANES; i += LINE) __builtin_prefetch(rows + i, intent);
}

// First of the sixteen coefficients of a row that are turned together: the last sixteen are pulled back, so that they
// end with the row, and repeat some work instead of touching the next row.
int piece_start(int coefficient) { return coefficient + LANES <= SH_REST ? coefficient : SH_REST - LANES; }

// planar[k][lane] = rows[lane][k] for at least the first `count` coefficients.
void to_planar(const float* rows, int count, Lanes* planar) {
  for (int first = 0; first < count; first += LANES) {
    const int start = piece_start(first);
    Vec square[LANES];
    for (int lane = 0; lane < LANES; lane++) square[lane] = load(rows + SH_REST * lane + start);
    transpose(square);
    for (int k = 0; k < LANES; k++) store(planar[start + k], square[k]);
  }
}

// rows[lane][k] = planar[k][lane], all coefficients.
void to_rows(const Lanes* planar, float* rows) {
  for (int first = 0; first < SH_REST; first += LANES) {
    const int start = piece_start(first);
    Vec square[LANES];
    for (int k = 0; k < LANES; k++) square[k] = load(planar[start + k]);
    transpose(square);
    for (int lane = 0; lane < LANES; lane++) store(rows + SH_REST * lane + start, square[lane]);
  }
}

// The table's rows of coefficients, turned into one planar row per coefficient.
void load_coefficients(const Harmonics& table, Block& block) {
  const float* rows = table.rest + SH_REST * block.first;
  prefetch_block<FOR_READING>(rows + SH_REST * LANES);
  float tail[LANES][SH_REST];
  if (block.rows < LANES) {
    for (int lane = 0; lane < LANES; lane++) {
      const int row = lane < block.rows ? lane : block.rows - 1;
      for (int k = 0; k < SH_REST; k++) tail[lane][k] = rows[SH_REST * row + k];
    }
    rows = tail[0];
  }
  to_planar(rows, 3 * block.count, block.coefficients);
}

void sum_harmonics(const Harmonics& table, Block& block) {
  const float* constant = table.constant + 3 * block.first;
  for (int lane = 0; lane < LANES; lane++) {
    const int row = lane < block.rows ? lane : block.rows - 1;
    for (int c = 0; c < 3; c++) block.sums[c][lane] = GREY + C0 * constant[3 * row + c];
  }
  for (int c = 0; c < 3; c++) {
    Lanes sum;
    for (int i = 0; i < LANES; i++) sum[i] = block.sums[c][i];
    for (int k = 0; k < block.count; k++)
      for (int i = 0; i < LANES; i++) sum[i] += block.basis[k][i] * block.coefficients[3 * k + c][i];
    for (int i = 0; i < LANES; i++) block.sums[c][i] = sum[i];
  }
}

void evaluate(const Harmonics& table, std::size_t first, std::size_t end, Block& block) {
  block.first = first;
  block.rows = end - first < LANES ? static_cast<int>(end - first) : LANES;
  block.count = (table.degree + 1) * (table.degree + 1) - 1;
  find_directions(table, block);
  find_basis(table.degree, block);
  if (block.count > 0) load_coefficients(table, block);
  sum_harmonics(table, block);
}

// dL/d(sum): nothing passes where the colour was clamped at black.
void load_upstream(const float* upstream, const Block& block, Lanes* by_sum) {
  for (int lane = 0; lane < LANES; lane++) {
    const int row = lane < block.rows ? lane : block.rows - 1;
    const float* gradient = upstream + 3 * (block.first + row);
    for (int c = 0; c < 3; c++) by_sum[c][lane] = block.sums[c][lane] >= 0 ? gradient[c] : 0.0f;
  }
}

// dL/d(direction) from dL/d(basis), by the derivatives of the polynomials in find_basis.
void direction_gradient(int degree, const Block& block, const Lanes* w, Lanes* by_direction) {
  Lanes &gx = by_direction[0], &gy = by_direction[1], &gz = by_direction[2];
  for (int i = 0; i < LANES; i++) {
    gx[i] = -C1 * w[2][i];
    gy[i] = -C1 * w[0][i];
    gz[i] = C1 * w[1][i];
  }
  if (degree >= 2)
    for (int i = 0; i < LANES; i++) {
      const float x = block.x[i], y = block.y[i], z = block.z[i];
      gx[i] += C2[1] * (y * w[3][i] - z * w[6][i]) + 2 * x * (C2[2] * w[7][i] - C2[0] * w[5][i]);
      gy[i] += C2[1] * (x * w[3][i] - z * w[4][i]) - 2 * y * (C2[2] * w[7][i] + C2[0] * w[5][i]);
      gz[i] += 4 * C2[0] * z * w[5][i] - C2[1] * (y * w[4][i] + x * w[6][i]);
    }
  if (degree >= 3)
    for (int i = 0; i < LANES; i++) {
      const float x = block.x[i], y = block.y[i], z = block.z[i];
      const float xx = x * x, yy = y * y, zz = z * z, xy = x * y, xz = x * z, yz = y * z;
      gx[i] += C3[3] * (-6 * xy * w[8][i] - 3 * (xx - yy) * w[14][i]) + 2 * C3[2] * (yz * w[9][i] + xz * w[13][i]) +
               C3[1] * (2 * xy * w[10][i] - (4 * zz - 3 * xx - yy) * w[12][i]) - 6 * C3[0] * xz * w[11][i];
      gy[i] += C3[3] * (6 * xy * w[14][i] - 3 * (xx - yy) * w[8][i]) + 2 * C3[2] * (xz * w[9][i] - yz * w[13][i]) +
               C3[1] * (2 * xy * w[12][i] - (4 * zz - xx - 3 * yy) * w[10][i]) - 6 * C3[0] * yz * w[11][i];
      gz[i] += C3[2] * (2 * xy * w[9][i] + (xx - yy) * w[13][i]) - 8 * C3[1] * (yz * w[10][i] + xz * w[12][i]) +
               3 * C3[0] * (2 * zz - xx - yy) * w[11][i];
    }
}

// Through the normalization: only what is across the direction moves it, the less the farther away.
void store_means(const Block& block, const Lanes* by_direction, float* means) {
  Lanes by_mean[3];
  for (int i = 0; i < LANES; i++) {
    const float x = block.x[i], y = block.y[i], z = block.z[i], scale = block.inverse_distance[i];
    const float along = x * by_direction[0][i] + y * by_direction[1][i] + z * by_direction[2][i];
    by_mean[0][i] = scale * (by_direction[0][i] - x * along);
    by_mean[1][i] = scale * (by_direction[1][i] - y * along);
    by_mean[2][i] = scale * (by_direction[2][i] - z * along);
  }
  for (int lane = 0; lane < block.rows; lane++)
    for (int axis = 0; axis < 3; axis++) means[3 * (block.first + lane) + axis] = by_mean[axis][lane];
}

// The coefficients' gradients take their place in the block, and from there go to the rows of the table.
void store_rest(Block& block, const Lanes* by_sum, float* rest) {
  Lanes* const coefficients = block.coefficients;
  for (int k = 0; k < block.count; k++)
    for (int c = 0; c < 3; c++)
#pragma GCC ivdep
      for (int i = 0; i < LANES; i++) coefficients[3 * k + c][i] = block.basis[k][i] * by_sum[c][i];
  for (int k = 3 * block.count; k < SH_REST; k++)
    for (int i = 0; i < LANES; i++) coefficients[k][i] = 0;
  float* rows = rest + SH_REST * block.first;
  prefetch_block<FOR_WRITING>(rows + SH_REST * LANES);
  if (block.rows == LANES) return to_rows(block.coefficients, rows);
  for (int lane = 0; lane < block.rows; lane++)
    for (int k = 0; k < SH_REST; k++) rows[SH_REST * lane + k] = block.coefficients[k][lane];
}

void store_gradient(const Harmonics& table, const float* upstream, const HarmonicsGradient& gradient,
                    Block& block) {
  Lanes by_sum[3], by_basis[15], by_direction[3] = {};
  load_upstream(upstream, block, by_sum);
  for (int lane = 0; lane < block.rows; lane++)
    for (int c = 0; c < 3; c++) gradient.constant[3 * (block.first + lane) + c] = C0 * by_sum[c][lane];
  for (int k = 0; k < block.count; k++) {
    const auto* row = &block.coefficients[3 * k];
    for (int i = 0; i < LANES; i++)
      by_basis[k][i] = row[0][i] * by_sum[0][i] + row[1][i] * by_sum[1][i] + row[2][i] * by_sum[2][i];
  }
  if (table.degree > 0) direction_gradient(table.degree, block, by_basis, by_direction);
  store_means(block, by_direction, gradient.means);
  store_rest(block, by_sum, gradient.rest);
}

}  // namespace

void sh_colors(const Harmonics& table, float* colors) {
  parallel_ranges(table.count, GRAIN, [&](std::size_t begin, std::size_t end) {
    Block block;
    for (std::size_t first = begin; first < end; first += LANES) {
      evaluate(table, first, end, block);
      for (int lane = 0; lane < block.rows; lane++)
        for (int c = 0; c < 3; c++) {
          const float sum = block.sums[c][lane];
          colors[3 * (first + lane) + c] = sum < 0 ? 0.0f : sum;  // NaN stays
        }
    }
  });
}

void sh_gradient(const Harmonics& table, const float* upstream, const HarmonicsGradient& gradient) {
  parallel_ranges(table.count, GRAIN, [&](std::size_t begin, std::size_t end) {
    Block block;
    for (std::size_t first = begin; first < end; first += LANES) {
      evaluate(table, first, end, block);
      store_gradient(table, upstream, gradient, block);
    }
  });
}

}  // namespace ringlight::RINGLIGHT_ISA
