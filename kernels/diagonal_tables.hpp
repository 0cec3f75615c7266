// The diagonal ring's tables as its kernel reads them, and one Gaussian's components in them. Floats are read where they
// are; where Terms are pairs, each cell holds what its interpolation multiplies, in half the cache lines.
// Include from kernels/isa/*.cpp alone, see simd.hpp.
#pragma once
#include "arena.hpp"
#include "lane_tables.hpp"
#include "ring.hpp"

namespace ringlight::RINGLIGHT_ISA {

// Floats: the parameters' tables. Pairs: on an axis (a, b - a) at the node of a, the next one being b; on the map, two
// lines at the upper left node, (a, b - a) and (c - a, d - c - b + a), where c and d are below a and b.
struct DiagonalTables {
  const float *axes, *view;
};

// Sixteen components, or the last few of a row.
struct WholePart {
  Vec from(const float* values) const { return load(values); }
  template <class Values>
  void put(float* to, Values value) const { store(to, value); }
};
struct LastPart {
  int count;
  Vec from(const float* values) const { return load_first(values, count); }
  void put(float* to, Vec value) const { store_first(to, value, count); }
};

template <class Each>
static inline __attribute__((always_inline)) void each_part(int width, Each each) {
  int first = 0;
  for (; first + LANES <= width; first += LANES) each(first, WholePart{});
  if (first < width) each(first, LastPart{width - first});
}

template <class Terms>
static inline DiagonalTables pack_tables(const RingShape& shape, const RingParameters<const float>& from,
                                         Arena& arena) {
  if constexpr (numbers_of<Terms> == 1) {
    return {from.axes, from.view};
  } else {
    const int width = static_cast<int>(matrix_size(shape)), side = shape.view_nodes;
    float *axes = arena.take(3 * axis_size(shape)), *view = arena.take(2 * view_size(shape));
    if (!axes) return {axes, view};
    const auto node = [width](std::size_t index) { return index * width; };
    for (int axis = 0; axis < 3; axis++)
      for (int cell = 0; cell + 1 < shape.nodes; cell++) {
        const std::size_t at = axis * axis_size(shape) + node(cell);
        each_part(width, [&](int first, auto part) {
          const Vec a = part.from(from.axes + at + first), b = part.from(from.axes + at + width + first);
          part.put(axes + at + first, Terms::of(a, b - a).bits());
        });
      }
    for (int down = 0; down + 1 < side; down++)
      for (int across = 0; across + 1 < side; across++) {
        const std::size_t at = node(static_cast<std::size_t>(down) * side + across);
        each_part(width, [&](int first, auto part) {
          const float *upper = from.view + at + first, *lower = upper + node(side);
          const Vec a = part.from(upper), b = part.from(upper + width), c = part.from(lower);
          part.put(view + 2 * at + first, Terms::of(a, b - a).bits());
          part.put(view + 2 * at + width + first, Terms::of(c - a, part.from(lower + width) - c - b + a).bits());
        });
      }
    return {axes, view};
  }
}

// Where sixteen Gaussians fall in the tables.
struct DiagonalCells {
  const Cells *axes, *across, *down;
};

// Where one Gaussian's components lie in the tables, and with which weights they are mixed: worked out once for all
// components.
struct DiagonalPlace {
  std::size_t axis[3], view;  // the first component's, at the node below
  Vec fraction[3], right, down;

  DiagonalPlace(const RingShape& shape, const DiagonalCells& cells, int lane) {
    const std::size_t width = matrix_size(shape);
    for (int c = 0; c < 3; c++) {
      axis[c] = c * axis_size(shape) + static_cast<std::size_t>(cells.axes[c].cell[lane]) * width;
      fraction[c] = Vec(cells.axes[c].fraction[lane]);
    }
    view = (static_cast<std::size_t>(cells.down->cell[lane]) * shape.view_nodes + cells.across->cell[lane]) * width;
    right = Vec(cells.across->fraction[lane]), down = Vec(cells.down->fraction[lane]);
  }
};

// The weights of sixteen Gaussians in the pairs; none are needed for floats.
template <class Terms>
struct DiagonalWeights {
  alignas(64) float axis[3][LANES], upper[LANES], lower[LANES];

  explicit DiagonalWeights(const DiagonalCells& cells) {
    if constexpr (numbers_of<Terms> == 2) {
      for (int c = 0; c < 3; c++) store(axis[c], Terms::of(Vec(1.f), load(cells.axes[c].fraction)));
      const Vec right = load(cells.across->fraction), below = load(cells.down->fraction);
      store(upper, Terms::of(Vec(1.f), right));
      store(lower, Terms::of(below, below * right));
    }
  }
};

// x, y, z and view components of one Gaussian, from `first`.
struct DiagonalFactors {
  Vec x, y, z, view;
};

template <class Terms, class Part>
static inline __attribute__((always_inline)) DiagonalFactors read_factors(
    const RingShape& shape, const DiagonalTables& tables, const DiagonalPlace& at,
    const DiagonalWeights<Terms>& weights, int lane, int first, Part part) {
  const std::size_t width = matrix_size(shape);
  if constexpr (numbers_of<Terms> == 1) {
    const auto mix = [](Vec a, Vec b, Vec weight) { return fma(weight, b - a, a); };
    const auto on_axis = [&](int c) {
      const float* below = tables.axes + at.axis[c] + first;
      return mix(part.from(below), part.from(below + width), at.fraction[c]);
    };
    const float *upper = tables.view + at.view + first, *lower = upper + width * shape.view_nodes;
    const Vec above = mix(part.from(upper), part.from(upper + width), at.right);
    const Vec below = mix(part.from(lower), part.from(lower + width), at.right);
    return {on_axis(0), on_axis(1), on_axis(2), mix(above, below, at.down)};
  } else {
    const auto on_axis = [&](int c) {
      return fma(Terms(part.from(tables.axes + at.axis[c] + first)), Terms(weights.axis[c][lane]), Vec(0.f));
    };
    const float* cell = tables.view + 2 * at.view + first;
    const Vec above = fma(Terms(part.from(cell)), Terms(weights.upper[lane]), Vec(0.f));
    return {on_axis(0), on_axis(1), on_axis(2),
            fma(Terms(part.from(cell + width)), Terms(weights.lower[lane]), above)};
  }
}

}  // namespace ringlight::RINGLIGHT_ISA
