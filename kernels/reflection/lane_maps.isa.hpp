// Octahedral feature maps for sixteen directions, one per lane: features with their slopes, and the way back. A
// node's features are consecutive, in fours, so that one corner of one lane is one load, whatever the processor.
#pragma once
#include <cstring>

#include "convention.hpp"
#include "dense/lane_tables.isa.hpp"
#include "simd/octahedral.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

constexpr int QUAD = convention::REFLECTION_QUAD;
using Quad = float __attribute__((vector_size(16)));
using QuadInMemory = float __attribute__((vector_size(16), aligned(4), may_alias));

RINGLIGHT_INLINE Quad load_quad(const float* from) { return *reinterpret_cast<const QuadInMemory*>(from); }
RINGLIGHT_INLINE void store_quad(float* to, Quad value) { *reinterpret_cast<QuadInMemory*>(to) = value; }

// One level of a map, [side side features], and where sixteen points fall on it.
struct LevelPoints {
  alignas(64) std::int32_t corner[LANES];  // the first feature of the node below
  alignas(64) float across[LANES], down[LANES];
};

// The node below a coordinate of [-1, 1], and in `fraction` the way to the next; as locate() has it.
RINGLIGHT_INLINE Vec node_below(Vec coordinate, int side, Vec& fraction) {
  const Vec inside = min(max(coordinate, Vec(-1.f)), Vec(1.f));
  const Vec position = (inside + Vec(1.f)) * Vec(0.5f * static_cast<float>(side - 1));
  const Vec node = min(floor(position), Vec(static_cast<float>(side - 2)));
  fraction = position - node;
  return node;
}

static inline void locate(const OctahedralPoint& point, int side, int features, LevelPoints& at) {
  Vec across, down;
  const Vec column = node_below(point.u, side, across), row = node_below(point.v, side, down);
  // Exact: a map has at most 2^24 numbers.
  store(at.corner, truncate(fma(row, Vec(static_cast<float>(side)), column) * Vec(static_cast<float>(features))));
  store(at.across, across);
  store(at.down, down);
}

struct Level {
  const float* map;
  int side, features;
};

// Four features of sixteen points, a lane's side by side, and their slopes.
struct Quads {
  alignas(64) float values[LANES * QUAD], across[LANES * QUAD], down[LANES * QUAD];
};

// Of the points 4 Quarter to 4 Quarter + 3: one Vec for all their features.
template <bool Slopes, int Quarter>
RINGLIGHT_INLINE void read_quarter(const float* map, const LevelPoints& at, int right, int below, Quads& quads) {
  const float* const corner[4] = {map + at.corner[4 * Quarter], map + at.corner[4 * Quarter + 1],
                                  map + at.corner[4 * Quarter + 2], map + at.corner[4 * Quarter + 3]};
  const auto nodes = [&](int offset) {
    return load_quarters(corner[0] + offset, corner[1] + offset, corner[2] + offset, corner[3] + offset);
  };
  const Vec x = repeat_quarter<Quarter>(load(at.across)), y = repeat_quarter<Quarter>(load(at.down));
  const Vec upper = nodes(0), lower = nodes(below);
  const Vec step = nodes(right) - upper, lower_step = nodes(below + right) - lower;
  const Vec top = fma(x, step, upper), drop = fma(x, lower_step, lower) - top;
  constexpr int first = Quarter * 4 * QUAD;
  store(quads.values + first, fma(y, drop, top));
  if constexpr (!Slopes) return;
  store(quads.across + first, fma(y, lower_step - step, step));
  store(quads.down + first, drop);
}

RINGLIGHT_INLINE void quads_to_lanes(const float* quads, float* lanes, int stride) {
  Vec columns[QUAD];
  load_columns(quads, columns[0], columns[1], columns[2], columns[3]);
  for (int k = 0; k < QUAD; k++) store(lanes + k * stride, columns[k]);
}

// Feature k of the level goes to lanes[k * stride]; with Slopes its change from one node to the next as well.
template <bool Slopes>
static void read_level(const Level& level, const LevelPoints& at, int stride, float* lanes, float* slopes_across,
                       float* slopes_down) {
  const int right = level.features, below = level.side * level.features;
  Quads quads;
  for (int first = 0; first < level.features; first += QUAD) {
    const float* const map = level.map + first;
    read_quarter<Slopes, 0>(map, at, right, below, quads);
    read_quarter<Slopes, 1>(map, at, right, below, quads);
    read_quarter<Slopes, 2>(map, at, right, below, quads);
    read_quarter<Slopes, 3>(map, at, right, below, quads);
    quads_to_lanes(quads.values, lanes + first * stride, stride);
    if constexpr (!Slopes) continue;
    quads_to_lanes(quads.across, slopes_across + first * stride, stride);
    quads_to_lanes(quads.down, slopes_down + first * stride, stride);
  }
}

RINGLIGHT_INLINE void add_quad(float* to, Quad value) { store_quad(to, load_quad(to) + value); }

// Adds the gradient of a level's features, lane after lane, to `map`.
static inline void add_to_level(float* map, int side, int features, const LevelPoints& at, int stride,
                                const float* lanes) {
  const int right = features, below = side * features;
  alignas(64) float values[LANES * QUAD];
  for (int first = 0; first < features; first += QUAD) {
    const float* from = lanes + first * stride;
    store_columns(values, load(from), load(from + stride), load(from + 2 * stride), load(from + 3 * stride));
    for (int lane = 0; lane < LANES; lane++) {
      float* corner = map + at.corner[lane] + first;
      const Quad value = load_quad(values + lane * QUAD);
      const Quad lower = at.down[lane] * value, upper = value - lower;
      const Quad lower_right = at.across[lane] * lower, upper_right = at.across[lane] * upper;
      add_quad(corner, upper - upper_right);
      add_quad(corner + right, upper_right);
      add_quad(corner + below, lower - lower_right);
      add_quad(corner + below + right, lower_right);
    }
  }
}

// The mean of the two nodes, in place.
RINGLIGHT_INLINE void even_out(float* one, float* other, int features) {
  for (int k = 0; k < features; k++) one[k] = other[k] = 0.5f * (one[k] + other[k]);
}

// Gives nodes on the square's edge that stand for one direction one value, their mean. The gradient's way back is the
// same sum, for the mean is symmetric.
static inline void sew(float* map, int side, int features) {
  const auto node = [=](int row, int column) {
    return map + (static_cast<std::size_t>(row) * side + column) * features;
  };
  for (int edge = 0; edge < side; edge += side - 1)
    for (int i = 0; 2 * i < side - 1; i++) even_out(node(edge, i), node(edge, side - 1 - i), features);
  for (int edge = 0; edge < side; edge += side - 1)
    for (int j = 0; 2 * j < side - 1; j++) even_out(node(j, edge), node(side - 1 - j, edge), features);
}

}  // namespace ringlight::RINGLIGHT_ISA
