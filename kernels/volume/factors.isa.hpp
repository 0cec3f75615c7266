// Planes times lines, or three lines, at one place: lanes are components.
#pragma once
#include "simd/simd.isa.hpp"
#include "volume/volume.hpp"

namespace ringlight::RINGLIGHT_ISA {

// The node before a place along an axis, and the share of the way to the next.
struct Between {
  int low;
  float share;
};

RINGLIGHT_INLINE Between between(float place, int side) {
  const float clamped = place > 0.f ? (place < 1.f ? place : 1.f) : 0.f;  // a NaN becomes 0
  const float at = clamped * static_cast<float>(side - 1);
  const int low = static_cast<int>(at) < side - 2 ? static_cast<int>(at) : side - 2;
  return {low, at - static_cast<float>(low)};
}

// Where a place lies in one pair: offsets of the four corners of a plane and both ends of a line, and their shares.
struct Corners {
  std::size_t plane[4], line[2];
  float plane_share[4], line_share[2];
};

template <class Float>
RINGLIGHT_INLINE Corners corners_of(const VolumeFactors<Float>& factors, int pair, const float* place) {
  const int *axes = VOLUME_PAIR_AXES[pair], *sides = factors.sides;
  const Between a = between(place[axes[0]], sides[axes[0]]), b = between(place[axes[1]], sides[axes[1]]);
  const Between c = between(place[axes[2]], sides[axes[2]]);
  const std::size_t width = static_cast<std::size_t>(factors.components);
  const std::size_t row = width * static_cast<std::size_t>(sides[axes[0]]);
  const std::size_t first = static_cast<std::size_t>(b.low) * row + static_cast<std::size_t>(a.low) * width;
  const float left = 1.f - a.share, top = 1.f - b.share;
  return {{first, first + width, first + row, first + row + width},
          {static_cast<std::size_t>(c.low) * width, static_cast<std::size_t>(c.low) * width + width},
          {top * left, top * a.share, b.share * left, b.share * a.share},
          {1.f - c.share, c.share}};
}

RINGLIGHT_INLINE Vec on_plane(const float* plane, const Corners& at, int first) {
  Vec sum = Vec(at.plane_share[0]) * load(plane + at.plane[0] + first);
  sum = fma(Vec(at.plane_share[1]), load(plane + at.plane[1] + first), sum);
  sum = fma(Vec(at.plane_share[2]), load(plane + at.plane[2] + first), sum);
  return fma(Vec(at.plane_share[3]), load(plane + at.plane[3] + first), sum);
}

RINGLIGHT_INLINE Vec on_line(const float* line, const Corners& at, int first) {
  const Vec sum = Vec(at.line_share[0]) * load(line + at.line[0] + first);
  return fma(Vec(at.line_share[1]), load(line + at.line[1] + first), sum);
}

// Where a place lies on three lines: the offset of the node before it on each, and the share of the way to the next.
struct OnLines {
  std::size_t low[3], width;
  float share[3];
};

template <class Float>
RINGLIGHT_INLINE OnLines on_lines(const VolumeFactors<Float>& factors, const float* place) {
  OnLines at;
  at.width = static_cast<std::size_t>(factors.components);
  for (int axis = 0; axis < 3; axis++) {
    const Between here = between(place[axis], factors.sides[axis]);
    at.low[axis] = static_cast<std::size_t>(here.low) * at.width, at.share[axis] = here.share;
  }
  return at;
}

RINGLIGHT_INLINE Vec along(const VolumeFactors<const float>& factors, const OnLines& at, int axis, int first) {
  const float* node = factors.lines[axis] + at.low[axis] + first;
  const Vec low = load(node);
  return fma(Vec(at.share[axis]), load(node + at.width) - low, low);
}

RINGLIGHT_INLINE Vec of_lines(const VolumeFactors<const float>& factors, const OnLines& at, int first) {
  return along(factors, at, 0, first) * along(factors, at, 1, first) * along(factors, at, 2, first);
}

// Components of sixteen, still side by side, whose lanes add up to the sum of all components.
static inline Vec summed_components(const VolumeFactors<const float>& factors, const float* place) {
  Vec sum(0.f);
  if (!factors.has_planes()) {
    const OnLines at = on_lines(factors, place);
    for (int first = 0; first < factors.components; first += LANES) sum += of_lines(factors, at, first);
    return sum;
  }
  for (int pair = 0; pair < VOLUME_PAIRS; pair++) {
    const Corners at = corners_of(factors, pair, place);
    for (int first = 0; first < factors.components; first += LANES)
      sum = fma(on_plane(factors.planes[pair], at, first), on_line(factors.lines[pair], at, first), sum);
  }
  return sum;
}

// All of them, pair after pair.
static inline void components_at(const VolumeFactors<const float>& factors, const float* place, float* to) {
  if (!factors.has_planes()) {
    const OnLines at = on_lines(factors, place);
    for (int first = 0; first < factors.components; first += LANES) store(to + first, of_lines(factors, at, first));
    return;
  }
  for (int pair = 0; pair < VOLUME_PAIRS; pair++) {
    const Corners at = corners_of(factors, pair, place);
    for (int first = 0; first < factors.components; first += LANES, to += LANES)
      store(to, on_plane(factors.planes[pair], at, first) * on_line(factors.lines[pair], at, first));
  }
}

// What softplus is taken of, at up to sixteen places; the other lanes are 0.
static inline Vec densities_at(const VolumeFactors<const float>& factors, const float* places, int count) {
  Vec sums[LANES];
  for (int i = 0; i < LANES; i++) sums[i] = i < count ? summed_components(factors, places + 3 * i) : Vec(0.f);
  return lane_sums<LANES>(sums);
}

}  // namespace ringlight::RINGLIGHT_ISA
