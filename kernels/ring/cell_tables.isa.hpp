// The ring's tables as kernels read them, and one Gaussian's components (or elements of matrices) in them. Floats are
// read where they are; where Terms are pairs, each cell holds what its interpolation multiplies, in half the cache
// lines.
#pragma once
#include "dense/lane_tables.isa.hpp"
#include "machine/parallel.hpp"
#include "machine/scratch.isa.hpp"
#include "ring/ring.hpp"

namespace ringlight::RINGLIGHT_ISA {

constexpr int TILE = 4;  // rows and columns of a matrix that fill one Vec

// Whether matrices are multiplied tile by tile (product_tiles.isa.hpp): where there are pairs, and for ranks whose
// tiles fill whole Vecs of them.
template <class Terms>
static inline bool in_tiles(const RingShape& shape) {
  return numbers_of<Terms> == 2 && !shape.diagonal && (shape.rank == 4 || shape.rank == 8 || shape.rank == 16);
}

// Floats: the parameters' tables. Pairs: on an axis (a, b - a) at the node of a, the next one being b; on the map, two
// lines at the upper left node, (a, b - a) and (c - a, d - c - b + a), where c and d are below a and b. Matrices in
// tiles are packed tile after tile, each tile row by row.
struct CellTables {
  const float *axes, *view;
};

constexpr std::size_t CELL_GRAIN = 16384;  // floats a piece

// `read(node, first, part)` gives the components from `first` of a node, in the order in which they are packed.
template <class Terms, class Read>
static inline CellTables pack_cells(const RingShape& shape, const RingParameters<const float>& from, Arena& arena,
                                    Read read) {
  const int width = static_cast<int>(matrix_size(shape)), side = shape.view_nodes;
  float *axes = arena.take(3 * axis_size(shape)), *view = arena.take(2 * view_size(shape));
  if (!axes) return {axes, view};
  const std::size_t grain = 1 + CELL_GRAIN / width;
  parallel_ranges(3 * static_cast<std::size_t>(shape.nodes) - 1, grain, [=](std::size_t begin, std::size_t end) {
    for (std::size_t cell = begin; cell < end; cell++) {  // the last of an axis is never read
      const float* node = from.axes + cell * width;
      each_part(width, [&](int first, auto part) {
        const Vec a = read(node, first, part), b = read(node + width, first, part);
        part.put(axes + cell * width + first, Terms::of(a, b - a).bits());
      });
    }
  });
  parallel_ranges(view_size(shape) / width - side - 1, grain, [=](std::size_t begin, std::size_t end) {
    for (std::size_t cell = begin; cell < end; cell++) {  // nor is the last of a line
      const float *upper = from.view + cell * width, *lower = upper + side * width;
      float* const to = view + 2 * cell * width;
      each_part(width, [&](int first, auto part) {
        const Vec a = read(upper, first, part), b = read(upper + width, first, part), c = read(lower, first, part);
        part.put(to + first, Terms::of(a, b - a).bits());
        part.put(to + width + first, Terms::of(c - a, read(lower + width, first, part) - c - b + a).bits());
      });
    }
  });
  return {axes, view};
}

template <class Terms>
static inline CellTables pack_tables(const RingShape& shape, const RingParameters<const float>& from, Arena& arena) {
  if constexpr (numbers_of<Terms> == 1) {
    return {from.axes, from.view};
  } else {
    const int rank = shape.rank, tiles = rank / TILE;
    if (!in_tiles<Terms>(shape))
      return pack_cells<Terms>(shape, from, arena,
                               [](const float* node, int first, auto part) { return part.from(node + first); });
    return pack_cells<Terms>(shape, from, arena, [rank, tiles](const float* node, int first, auto) {
      const int tile = first / LANES;
      return Terms::load_quarters(node + tile / tiles * TILE * rank + tile % tiles * TILE, rank);
    });
  }
}

// Where sixteen Gaussians fall in the tables.
struct RingCells {
  const Cells *axes, *across, *down;
};

// Where one Gaussian's components lie in the tables, and with which weights they are mixed: worked out once for all
// components.
struct RingPlace {
  std::size_t axis[3], view;  // the first component's, at the node below
  Vec fraction[3], right, down;

  RingPlace(const RingShape& shape, const RingCells& cells, int lane) {
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
struct CellWeights {
  alignas(64) float axis[3][LANES], upper[LANES], lower[LANES];

  explicit CellWeights(const RingCells& cells) {
    if constexpr (numbers_of<Terms> == 2) {
      for (int c = 0; c < 3; c++) store(axis[c], Terms::of(Vec(1.f), load(cells.axes[c].fraction)));
      const Vec right = load(cells.across->fraction), below = load(cells.down->fraction);
      store(upper, Terms::of(Vec(1.f), right));
      store(lower, Terms::of(below, below * right));
    }
  }
};

// x, y, z and view components of one Gaussian, from `first`.
struct RingFactors {
  Vec x, y, z, view;
};

template <class Terms, class Part>
static inline __attribute__((always_inline)) RingFactors read_factors(
    const RingShape& shape, const CellTables& tables, const RingPlace& at,
    const CellWeights<Terms>& weights, int lane, int first, Part part) {
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
