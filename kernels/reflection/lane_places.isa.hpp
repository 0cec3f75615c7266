// What the features of sixteen pixels are multiplied by, one pixel per lane: products of what three axes hold for the
// reflecting point (reference: src/ringlight/fields/axis_factors.py). A node's factors are consecutive: sixteen of a
// lane are one load.
#pragma once
#include "reflection/pixels.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

// Where sixteen points fall on the three axes.
struct PlacePoints {
  Cells axes[3];
};

static inline void locate(const ReflectionShape& shape, const Surface& surface, PlacePoints& at) {
  for (int c = 0; c < 3; c++) locate(surface.point[c], shape.axis_nodes, at.axes[c]);
}

// Up to sixteen factors of one lane on each axis; with Slopes their change from one node to the next as well.
struct PlaceFactors {
  Vec axis[3], slope[3];
};

// Where a lane's factors lie in [3 nodes width]: at the nodes below it.
struct Place {
  std::size_t node[3];
  Vec fraction[3];

  Place(const ReflectionShape& shape, const PlacePoints& at, int lane) {
    const std::size_t width = feature_count(shape);
    for (int c = 0; c < 3; c++) {
      node[c] = (static_cast<std::size_t>(c) * shape.axis_nodes + at.axes[c].cell[lane]) * width;
      fraction[c] = Vec(at.axes[c].fraction[lane]);
    }
  }
};

template <class Part>
RINGLIGHT_INLINE PlaceFactors read_factors(const float* axes, const Place& at, int width, int first, Part part) {
  PlaceFactors of;
  for (int c = 0; c < 3; c++) {
    const float* const node = axes + at.node[c] + first;
    const Vec below = part.from(node);
    of.slope[c] = part.from(node + width) - below;
    of.axis[c] = fma(at.fraction[c], of.slope[c], below);
  }
  return of;
}

// Factor k of the product goes to lanes[k * GROUP].
static inline void read_places(const ReflectionShape& shape, const float* axes, const PlacePoints& at, float* lanes) {
  const int width = feature_count(shape);
  each_part(width, [&](int first, auto part) __attribute__((always_inline)) {
    Vec square[LANES];
    for (int lane = 0; lane < LANES; lane++) {
      const PlaceFactors of = read_factors(axes, Place(shape, at, lane), width, first, part);
      square[lane] = of.axis[0] * of.axis[1] * of.axis[2];
    }
    transpose(square);
    for (int i = 0; i < LANES && first + i < width; i++) store(lanes + (first + i) * GROUP, square[i]);
  });
}

// The sum of each lane's sixteen.
static inline Vec sums_of_lanes(Vec square[LANES]) {
  transpose(square);
  Vec sum = square[0];
  for (int i = 1; i < LANES; i++) sum += square[i];
  return sum;
}

// From the gradient of the products, [width][GROUP], to that of the axes, lane after lane, and with Points to that of
// the point.
template <bool Points>
static void place_gradient(const ReflectionShape& shape, const float* axes, const Surface& surface,
                           const PlacePoints& at, const float* of_lanes, float* sums, SurfaceGradient& gradient) {
  const int width = feature_count(shape);
  Vec slopes[3][LANES];
  for (int lane = 0; lane < LANES && Points; lane++)
    for (int c = 0; c < 3; c++) slopes[c][lane] = Vec(0.f);
  each_part(width, [&](int first, auto part) __attribute__((always_inline)) {
    Vec square[LANES];
    for (int i = 0; i < LANES; i++)
      square[i] = first + i < width ? load(of_lanes + (first + i) * GROUP) : Vec(0.f);
    transpose(square);
    for (int lane = 0; lane < LANES; lane++) {
      const Place place(shape, at, lane);
      const PlaceFactors of = read_factors(axes, place, width, first, part);
      const Vec by_last = square[lane] * of.axis[2];
      const Vec of_axis[3] = {by_last * of.axis[1], by_last * of.axis[0], square[lane] * of.axis[0] * of.axis[1]};
      for (int c = 0; c < 3; c++) {
        float* const node = sums + place.node[c] + first;
        const Vec above = of_axis[c] * place.fraction[c];
        part.put(node, part.from(node) + of_axis[c] - above);
        part.put(node + width, part.from(node + width) + above);
        if constexpr (Points) slopes[c][lane] = fma(of_axis[c], of.slope[c], slopes[c][lane]);
      }
    }
  });
  if constexpr (!Points) return;
  const Vec nodes(0.5f * static_cast<float>(shape.axis_nodes - 1));
  for (int c = 0; c < 3; c++) {
    const Vec inside = keep(ge(Vec(1.f), abs(surface.point[c])), nodes);  // beyond, it is the end's
    gradient.point[c] = fma(inside, sums_of_lanes(slopes[c]), gradient.point[c]);
  }
}

}  // namespace ringlight::RINGLIGHT_ISA
