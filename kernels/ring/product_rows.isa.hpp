// The ring's product and its gradient for rank 16, where a row of a matrix is one Vec: one Gaussian at a time, its
// matrices never transposed, which takes an eighth less time than sixteen Gaussians at a time (lane_matrices.isa.hpp).
#pragma once
#include "ring/batch.isa.hpp"
#include "ring/sums.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

// Rows of the result whose sums stay in registers.
constexpr int ROW_BLOCK = MANY_REGISTERS ? 16 : 4;

// c = a b, where element (i, k) of a lies at a[i * Row + k * Column]; c must not overlap a or b.
template <int Row, int Column>
static inline void row_product(const float* a, const float* b, float* c) {
  for (int first = 0; first < ROW_RANK; first += ROW_BLOCK) {
    Vec sums[ROW_BLOCK];
#pragma GCC unroll 16
    for (int i = 0; i < ROW_BLOCK; i++) sums[i] = Vec(0.f);
    for (int k = 0; k < ROW_RANK; k++) {
      const Vec right = load(b + k * ROW_RANK);
#pragma GCC unroll 16
      for (int i = 0; i < ROW_BLOCK; i++) sums[i] = fma(Vec(a[(first + i) * Row + k * Column]), right, sums[i]);
    }
#pragma GCC unroll 16
    for (int i = 0; i < ROW_BLOCK; i++) store(c + (first + i) * ROW_RANK, sums[i]);
  }
}

static inline void times(const float* a, const float* b, float* c) { row_product<ROW_RANK, 1>(a, b, c); }
static inline void transposed_times(const float* a, const float* b, float* c) { row_product<1, ROW_RANK>(a, b, c); }

template <class Table>
static inline void read_matrix(const Table& at, const float* table, int lane, float* matrix) {
  for (int i = 0; i < MATRIX; i += LANES)
    store(matrix + i, at.template between<Vec>(table + i, lane, [](const float* from) { return load(from); }));
}

template <class Table>
static inline void add_matrix(const Table& at, float* table, int lane, const float* gradient) {
  for (int i = 0; i < MATRIX; i += LANES)
    at.template scatter<Vec>(table + i, lane, load(gradient + i),
                            [](float* to, Vec value) { store(to, load(to) + value); });
}

// multiply_ring for rank 16: leaves the matrices of a half by Gaussian, [16][R^2], instead of by element.
static inline void multiply_ring_rows(Batch& batch, const RingShape& shape,
                                      const RingParameters<const float>& parameters) {
  const std::size_t axis = axis_size(shape);
  alignas(64) float products[LANES * MATRIX];
  for (int half = 0; half < 2; half++) {
    RingHalf& ring = batch.halves[half];
    for (int lane = 0; lane < LANES; lane++) {
      const int at = batch.keep_ring ? lane * MATRIX : 0;  // else the first cache holds them
      read_matrix(AxisTable{MATRIX, ring.axes[0]}, parameters.axes, lane, ring.x + at);
      read_matrix(AxisTable{MATRIX, ring.axes[1]}, parameters.axes + axis, lane, ring.y + at);
      read_matrix(AxisTable{MATRIX, ring.axes[2]}, parameters.axes + 2 * axis, lane, ring.z + at);
      read_matrix(MapTable{MATRIX, shape.view_nodes, ring.across, ring.down}, parameters.view, lane, ring.view + at);
      times(ring.x + at, ring.y + at, ring.xy + at);
      times(ring.xy + at, ring.z + at, ring.xyz + at);
      times(ring.xyz + at, ring.view + at, products + lane * MATRIX);
    }
    for (int i = 0; i < MATRIX; i += LANES) {
      Vec square[LANES];
      for (int lane = 0; lane < LANES; lane++) square[lane] = load(products + lane * MATRIX + i);
      transpose(square);
      for (int k = 0; k < LANES; k++) store(batch.product + (i + k) * GROUP + half * LANES, square[k]);
    }
  }
}

// Elements first, first + step, ... of dL/d(product), sixteen of them for each Gaussian of a half.
static inline void gather_rows(const float* product, int first, int step, float* to) {
  Vec square[LANES];
  for (int k = 0; k < LANES; k++) square[k] = load(product + (first + k * step) * GROUP);
  transpose(square);
  for (int lane = 0; lane < LANES; lane++) store(to + lane * MATRIX, square[lane]);
}

// From dL/d(product), [R^2][GROUP], to the tables of a half. With the transposed gradient every factor appears as it is
// stored: dHz^T = dP^T (Hx Hy), and so on. The axes' sums are therefore kept transposed; add_up_shards turns them.
// `plain` and `turned` have room for sixteen matrices.
static inline void ring_gradient_rows(const RingHalf& ring, const RingShape& shape, const float* of_product,
                                      const ShardSums& sums, float* plain, float* turned) {
  for (int i = 0; i < ROW_RANK; i++) {
    gather_rows(of_product, i * ROW_RANK, 1, plain + i * ROW_RANK);
    gather_rows(of_product, i, ROW_RANK, turned + i * ROW_RANK);
  }
  const std::size_t axis = axis_size(shape);
  alignas(64) float upstream[MATRIX], inner[MATRIX], result[MATRIX];
  for (int lane = 0; lane < LANES; lane++) {
    const int at = lane * MATRIX;
    transposed_times(ring.xyz + at, plain + at, result);
    add_matrix(MapTable{MATRIX, shape.view_nodes, ring.across, ring.down}, sums.view, lane, result);
    times(ring.view + at, turned + at, upstream);
    times(upstream, ring.xy + at, result);
    add_matrix(AxisTable{MATRIX, ring.axes[2]}, sums.axes + 2 * axis, lane, result);
    times(ring.z + at, upstream, inner);
    times(inner, ring.x + at, result);
    add_matrix(AxisTable{MATRIX, ring.axes[1]}, sums.axes + axis, lane, result);
    times(ring.y + at, inner, result);
    add_matrix(AxisTable{MATRIX, ring.axes[0]}, sums.axes, lane, result);
  }
}

}  // namespace ringlight::RINGLIGHT_ISA
