// The diagonal ring (canonical polyadic decomposition): the product of four rows, component by component, and its
// gradient. Each Gaussian's components are read as they are stored, sixteen at a time; only the product is
// transposed.
#pragma once
#include "ring/cell_tables.isa.hpp"
#include "ring/product_rows.isa.hpp"
#include "ring/sums.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

// multiply_ring for diagonal matrices. Nothing but the product is left: the gradient reads the tables again.
static inline void multiply_diagonal(Batch& batch, const RingShape& shape, const CellTables& tables) {
  const int width = static_cast<int>(matrix_size(shape));
  for (int half = 0; half < 2; half++) {
    float* const rows = batch.halves[half].x;  // [16][padded(D)]
    const RingCells cells = cells_of(batch.halves[half]);
    const CellWeights<MatrixTerms> weights(cells);
    for (int lane = 0; lane < LANES; lane++) {
      const RingPlace at(shape, cells, lane);
      float* const row = rows + lane * padded(width);
      each_part(width, [&](int first, auto part) __attribute__((always_inline)) {
        const RingFactors of = read_factors(shape, tables, at, weights, lane, first, part);
        store(row + first, of.x * of.y * (of.z * of.view));
      });
    }
    for (int first = 0; first < width; first += LANES) {
      Vec square[LANES];
      for (int lane = 0; lane < LANES; lane++) square[lane] = load(rows + lane * padded(width) + first);
      transpose(square);
      const int count = width - first < LANES ? width - first : LANES;
      for (int i = 0; i < count; i++) store(batch.product + (first + i) * GROUP + half * LANES, square[i]);
    }
  }
}

// From dL/d(product), [D][GROUP], to the tables of a half.
static inline void ring_gradient_diagonal(const RingHalf& ring, const RingShape& shape,
                                          const CellTables& tables, const float* of_product,
                                          const ShardSums& sums) {
  const int width = static_cast<int>(matrix_size(shape));
  const std::size_t line = static_cast<std::size_t>(width) * shape.view_nodes;
  float* const rows = ring.x;
  for (int first = 0; first < width; first += LANES) {
    Vec square[LANES];
    for (int i = 0; i < LANES; i++) square[i] = first + i < width ? load(of_product + (first + i) * GROUP) : Vec(0.f);
    transpose(square);
    for (int lane = 0; lane < LANES; lane++) store(rows + lane * padded(width) + first, square[lane]);
  }
  const RingCells cells = cells_of(ring);
  const CellWeights<MatrixTerms> weights(cells);
  for (int lane = 0; lane < LANES; lane++) {
    const RingPlace at(shape, cells, lane);
    const float* const row = rows + lane * padded(width);
    each_part(width, [&](int first, auto part) __attribute__((always_inline)) {
      const RingFactors of = read_factors(shape, tables, at, weights, lane, first, part);
      const Vec slope = load(row + first), near = slope * of.x * of.y, far = slope * of.z * of.view;
      const auto scatter = [&](float* below, Vec value, Vec weight) {
        const Vec above = value * weight;
        part.put(below, part.from(below) + value - above);
        part.put(below + width, part.from(below + width) + above);
      };
      const Vec by_view = near * of.z, lower = by_view * at.down;
      scatter(sums.view + at.view + first, by_view - lower, at.right);
      scatter(sums.view + at.view + line + first, lower, at.right);
      scatter(sums.axes + at.axis[2] + first, near * of.view, at.fraction[2]);
      scatter(sums.axes + at.axis[1] + first, far * of.x, at.fraction[1]);
      scatter(sums.axes + at.axis[0] + first, far * of.y, at.fraction[0]);
    });
  }
}

}  // namespace ringlight::RINGLIGHT_ISA
