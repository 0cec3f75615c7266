// The ring's product for rank 8 in floats, one Gaussian at a time. A Vec holds two rows of a matrix: of a left factor
// by pairs of columns, of a right one column by column. So a pair of the left one, broadcast from memory, times two
// rows of the right one is a part of a row of the product, even and odd terms apart, and no matrix is transposed.
#pragma once
#include "ring/batch.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

constexpr int PAIR_RANK = 8, PAIR_MATRIX = PAIR_RANK * PAIR_RANK, PAIR_VECS = PAIR_MATRIX / LANES;

// Where element (i, j) of a left factor lies.
constexpr int left_place(int i, int j) { return i / 2 * LANES + j / 2 * 4 + i % 2 * 2 + j % 2; }

// The tables: H_x as left factors, the others as right ones.
struct PairTables {
  const float *axes, *view;
};

template <class Pairs>
static inline PairTables pack_pairs(const RingShape& shape, const RingParameters<const float>& from, Arena& arena) {
  float *axes = arena.take(3 * axis_size(shape)), *view = arena.take(view_size(shape));
  if (!axes) return {};
  const std::size_t axis = axis_size(shape), whole = view_size(shape);
  for (std::size_t i = 0; i < axis; i += LANES) store(axes + i, Pairs::left(load(from.axes + i)));
  for (std::size_t i = axis; i < 3 * axis; i += LANES) store(axes + i, Pairs::right(load(from.axes + i)));
  for (std::size_t i = 0; i < whole; i += LANES) store(view + i, Pairs::right(load(from.view + i)));
  return {axes, view};
}

template <class Table>
RINGLIGHT_INLINE void read_pairs(const Table& at, const float* table, int lane, Vec* matrix) {
#pragma GCC unroll 4
  for (int v = 0; v < PAIR_VECS; v++)
    matrix[v] = at.template between<Vec>(table + v * LANES, lane, [](const float* from) { return load(from); });
}

// `left` times `right`, as a left factor again.
template <class Pairs>
RINGLIGHT_INLINE void times_pairs(const float* left, const Vec* right, Vec* product) {
#pragma GCC unroll 4
  for (int v = 0; v < PAIR_VECS; v++) {
    Vec rows[2] = {Vec(0.f), Vec(0.f)};
#pragma GCC unroll 4
    for (int k = 0; k < PAIR_RANK; k += 2)
#pragma GCC unroll 2
      for (int i = 0; i < 2; i++) {
        const Vec pair = Pairs::broadcast(left + left_place(2 * v + i, k));
        rows[i] = fma(pair, right[k / 2], rows[i]);
      }
    product[v] = Pairs::sums(rows[0], rows[1]);
  }
}

// H_x H_y H_z H_v of a group, by left_place, as terms of a layer with a Gaussian to a row. Head by head, because the
// chain of one Gaussian is long: so the processor has many at hand. `products` has room for GROUP matrices.
template <class Pairs, class Terms>
static inline void multiply_pairs(const Batch& batch, const RingShape& shape, const PairTables& tables, float* products,
                                  float* terms) {
  const auto each = [&](auto run) __attribute__((always_inline)) {
    for (int i = 0; i < GROUP; i++) run(batch.halves[i / LANES], i % LANES, products + i * PAIR_MATRIX, i);
  };
  each([&](const RingHalf& half, int lane, float* product, int) {
    Vec matrix[PAIR_VECS];
    read_pairs(AxisTable{PAIR_MATRIX, half.axes[0]}, tables.axes, lane, matrix);
    for (int v = 0; v < PAIR_VECS; v++) store(product + v * LANES, matrix[v]);
  });
  for (int axis = 1; axis < 3; axis++)
    each([&](const RingHalf& half, int lane, float* product, int) {
      Vec matrix[PAIR_VECS], result[PAIR_VECS];
      read_pairs(AxisTable{PAIR_MATRIX, half.axes[axis]}, tables.axes + axis * axis_size(shape), lane, matrix);
      times_pairs<Pairs>(product, matrix, result);
      for (int v = 0; v < PAIR_VECS; v++) store(product + v * LANES, result[v]);
    });
  each([&](const RingHalf& half, int lane, float* product, int i) {
    Vec matrix[PAIR_VECS], result[PAIR_VECS];
    read_pairs(MapTable{PAIR_MATRIX, shape.view_nodes, half.across, half.down}, tables.view, lane, matrix);
    times_pairs<Pairs>(product, matrix, result);
    for (int step = 0; 2 * step < PAIR_VECS; step++)
      store(terms + (step * GROUP + i) * LANES, Terms::of_neighbours(result[2 * step], result[2 * step + 1]));
  });
}

}  // namespace ringlight::RINGLIGHT_ISA
