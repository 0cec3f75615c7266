// The diagonal ring (canonical polyadic decomposition): the product of four rows, component by component, and its
// gradient. Each Gaussian's components are read as they are stored, sixteen at a time; only the product is transposed.
// Include from kernels/isa/*.cpp alone, see simd.hpp.
#pragma once
#include "ring_rows.hpp"
#include "ring_sums.hpp"

namespace ringlight::RINGLIGHT_ISA {

// Where one Gaussian's components lie in the tables, or their gradients in the sums, and with which weights they are
// mixed: worked out once for all components.
struct DiagonalPlace {
  std::size_t axis[3], view;  // of the first component at the node below
  Vec fraction[3], right, down;

  DiagonalPlace(const RingShape& shape, const RingHalf& ring, int lane) {
    const std::size_t width = matrix_size(shape);
    for (int c = 0; c < 3; c++) {
      axis[c] = c * axis_size(shape) + static_cast<std::size_t>(ring.axes[c].cell[lane]) * width;
      fraction[c] = Vec(ring.axes[c].fraction[lane]);
    }
    view = (static_cast<std::size_t>(ring.down.cell[lane]) * shape.view_nodes + ring.across.cell[lane]) * width;
    right = Vec(ring.across.fraction[lane]), down = Vec(ring.down.fraction[lane]);
  }
};

// Sixteen components, or the last few of a row.
struct WholePart {
  Vec from(const float* values) const { return load(values); }
  void add(float* to, Vec value) const { store(to, load(to) + value); }
};
struct LastPart {
  int count;
  Vec from(const float* values) const { return load_first(values, count); }
  void add(float* to, Vec value) const { store_first(to, load_first(to, count) + value, count); }
};

template <class Each>
static inline __attribute__((always_inline)) void each_part(int width, Each each) {
  int first = 0;
  for (; first + LANES <= width; first += LANES) each(first, WholePart{});
  if (first < width) each(first, LastPart{width - first});
}

// x, y, z and view components of one Gaussian, from `first`.
struct DiagonalFactors {
  Vec x, y, z, view;

  template <class Part>
  __attribute__((always_inline)) DiagonalFactors(const RingShape& shape, const RingParameters<const float>& tables,
                                                 const DiagonalPlace& at, int first, Part part) {
    const std::size_t width = matrix_size(shape), line = width * shape.view_nodes;
    const auto mix = [](Vec a, Vec b, Vec weight) { return fma(weight, b - a, a); };
    const auto on_axis = [&](int c) {
      const float* below = tables.axes + at.axis[c] + first;
      return mix(part.from(below), part.from(below + width), at.fraction[c]);
    };
    const float *upper = tables.view + at.view + first, *lower = upper + line;
    x = on_axis(0), y = on_axis(1), z = on_axis(2);
    view = mix(mix(part.from(upper), part.from(upper + width), at.right),
               mix(part.from(lower), part.from(lower + width), at.right), at.down);
  }
};

// multiply_ring for diagonal matrices. Nothing but the product is left: the gradient reads the tables again.
static inline void multiply_diagonal(Batch& batch, const RingShape& shape,
                                     const RingParameters<const float>& parameters) {
  const int width = static_cast<int>(matrix_size(shape));
  for (int half = 0; half < 2; half++) {
    float* const rows = batch.halves[half].x;  // [16][padded(D)]
    for (int lane = 0; lane < LANES; lane++) {
      const DiagonalPlace at(shape, batch.halves[half], lane);
      float* const row = rows + lane * padded(width);
      each_part(width, [&](int first, auto part) __attribute__((always_inline)) {
        const DiagonalFactors of(shape, parameters, at, first, part);
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

// The ring's product, whatever its form.
static inline void multiply(Batch& batch, const RingShape& shape, const RingParameters<const float>& parameters) {
  if (shape.diagonal)
    multiply_diagonal(batch, shape, parameters);
  else if (by_rows(shape))
    multiply_ring_rows(batch, shape, parameters);
  else
    multiply_ring(batch, shape, parameters);
}

// From dL/d(product), [D][GROUP], to the tables of a half.
static inline void ring_gradient_diagonal(const RingHalf& ring, const RingShape& shape,
                                          const RingParameters<const float>& parameters, const float* of_product,
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
  for (int lane = 0; lane < LANES; lane++) {
    const DiagonalPlace at(shape, ring, lane);
    const float* const row = rows + lane * padded(width);
    each_part(width, [&](int first, auto part) __attribute__((always_inline)) {
      const DiagonalFactors of(shape, parameters, at, first, part);
      const Vec slope = load(row + first), near = slope * of.x * of.y, far = slope * of.z * of.view;
      const auto spread = [&](float* below, Vec value, Vec weight) {
        const Vec above = value * weight;
        part.add(below, value - above);
        part.add(below + width, above);
      };
      const Vec by_view = near * of.z, lower = by_view * at.down;
      spread(sums.view + at.view + first, by_view - lower, at.right);
      spread(sums.view + at.view + line + first, lower, at.right);
      spread(sums.axes + at.axis[2] + first, near * of.view, at.fraction[2]);
      spread(sums.axes + at.axis[1] + first, far * of.x, at.fraction[1]);
      spread(sums.axes + at.axis[0] + first, far * of.y, at.fraction[0]);
    });
  }
}

}  // namespace ringlight::RINGLIGHT_ISA
