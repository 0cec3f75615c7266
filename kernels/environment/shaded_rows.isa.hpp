// Sixteen Gaussians, one per lane: their normals, what they reflect, and how much of it.
#pragma once
#include "environment/lookup.isa.hpp"
#include "environment/shaded_rows.hpp"
#include "environment/shortest_axes.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

// The normal with its residual, the ray from the camera, and the ray reflected.
struct LaneSurface {
  ShortestAxes axes;
  Mask outward, stretched, has_distance;              // the side that is seen; lengths that count
  Vec means[LANES];                                   // three of them are read
  Vec normal[3], shortening, direction[3], nearness;  // one over the length of normal and ray
  Vec facing, reflected[3];                           // facing = direction.normal
};

RINGLIGHT_INLINE void unit(float smallest, const Vec from[3], Vec to[3], Vec& inverse, Mask& counts) {
  const Vec length = sqrt(inner(from, from)), least(smallest);
  counts = gt(length, least);
  inverse = Vec(1.f) / max(length, least);
  for (int c = 0; c < 3; c++) to[c] = from[c] * inverse;
}

// dL/d(vector) from dL/d(unit vector).
RINGLIGHT_INLINE void unit_gradient(const Vec of_unit[3], const Vec unit[3], Vec inverse, Mask counts, Vec to[3]) {
  const Vec radial = keep(counts, inner(of_unit, unit));
  for (int c = 0; c < 3; c++) to[c] = inverse * fnma(radial, unit[c], of_unit[c]);
}

static inline LaneSurface lane_surface(const ShadedRows& rows, std::size_t first, int count) {
  LaneSurface found;
  Vec residuals[LANES], axis[3], ray[3];
  take_columns(rows.surface.means + 3 * first, 3, count, found.means);
  take_columns(rows.residuals + 6 * first, 6, count, residuals);
  found.axes = shortest_axes(rows.surface, first, count, axis);
  found.outward = gt(found.axes.sign, Vec(0.f));
  for (int c = 0; c < 3; c++) axis[c] = axis[c] + select(found.outward, residuals[c], residuals[3 + c]);
  unit(rows.smallest_length, axis, found.normal, found.shortening, found.stretched);
  for (int c = 0; c < 3; c++) ray[c] = found.means[c] - Vec(rows.camera.position[c]);
  unit(rows.smallest_length, ray, found.direction, found.nearness, found.has_distance);
  found.facing = inner(found.direction, found.normal);
  for (int c = 0; c < 3; c++)
    found.reflected[c] = fnma(found.facing + found.facing, found.normal[c], found.direction[c]);
  return found;
}

// The two maps around a roughness, and where between them it lies.
struct LanePlaces {
  Vec between, slope;  // share of the way from the smoother map to the rougher one, and its derivative
  LaneFaces smoother, rougher;
};

static inline LanePlaces lane_places(const LightLevels& levels, Vec roughness) {
  LanePlaces found;
  const Vec zero(0.f), one(1.f);
  Vec level = zero;
  for (int i = 1; i + 1 < levels.count; i++) level = level + keep(gt(roughness, Vec(levels.roughness[i])), one);
  float before[convention::SHADED_MAX_LEVELS];
  std::size_t texels = 0;
  for (int i = 0; i < levels.count; i++) {
    before[i] = static_cast<float>(texels);
    texels += CubemapSize{levels.sides[i]}.floats() / TEXEL;
  }
  alignas(64) std::int32_t numbers[LANES];
  alignas(64) float lanes[6][LANES];
  store(numbers, truncate(level));
  for (int i = 0; i < LANES; i++) {
    const int smoother = numbers[i], rougher = smoother + 1;
    lanes[0][i] = static_cast<float>(levels.sides[smoother]), lanes[1][i] = before[smoother];
    lanes[2][i] = static_cast<float>(levels.sides[rougher]), lanes[3][i] = before[rougher];
    lanes[4][i] = levels.roughness[smoother], lanes[5][i] = levels.roughness[rougher];
    found.smoother.next_row[i] = CubemapSize{levels.sides[smoother]}.wide() * TEXEL;
    found.rougher.next_row[i] = CubemapSize{levels.sides[rougher]}.wide() * TEXEL;
  }
  found.smoother.side = load(lanes[0]), found.smoother.before = load(lanes[1]);
  found.rougher.side = load(lanes[2]), found.rougher.before = load(lanes[3]);
  const Vec low = load(lanes[4]), inverse = one / (load(lanes[5]) - low), share = (roughness - low) * inverse;
  found.between = min(max(share, zero), one);
  found.slope = keep(both(ge(share, zero), ge(one, share)), inverse);
  return found;
}

static inline LaneFaces diffuse_faces(const LightLevels& levels) {
  LaneFaces faces = same_faces({levels.sides[levels.count]});
  faces.before = Vec(static_cast<float>(levels.before(levels.count)));
  return faces;
}

// Both shares of the table, and their slopes.
struct LaneShares {
  Vec value[2], by_cosine[2], by_roughness[2];
};

static inline LaneShares lane_shares(const SpecularTable& of, Vec cosine, Vec roughness) {
  const Vec last(of.side - 1.f), most(of.side - 2.f);
  const Vec x = cosine * last, y = roughness * last;
  const Vec column = min(max(floor(x), Vec(0.f)), most), row = min(max(floor(y), Vec(0.f)), most);
  const Vec right = x - column, below = y - row;
  alignas(64) std::int32_t first[LANES];
  store(first, truncate(fma(column, Vec(static_cast<float>(of.side)), row) * Vec(2.f)));
  Vec nodes[LANES];
  for (int i = 0; i < LANES; i++) {
    const float *at = of.shares + first[i], *next = at + 2 * of.side;
    nodes[i] = load_quarters(at, next, at, next);
  }
  transpose(nodes);
  LaneShares found;
  for (int k = 0; k < 2; k++) {
    const Vec here = nodes[2 + k] - nodes[k], there = nodes[6 + k] - nodes[4 + k];
    const Vec near = fma(below, here, nodes[k]), far = fma(below, there, nodes[4 + k]);
    found.value[k] = fma(right, far - near, near);
    found.by_cosine[k] = (far - near) * last;
    found.by_roughness[k] = fma(right, there - here, here) * last;
  }
  return found;
}

}  // namespace ringlight::RINGLIGHT_ISA
