// The octahedral square of directions (core/directions.py is the reference), one direction a lane.
#pragma once
#include "convention.hpp"
#include "simd/simd.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

// The square of Meyer et al. (2010): where a direction of any length falls, and what its gradient needs.
struct OctahedralPoint {
  Vec u, v;
  Vec inverse;         // 1 / (|x| + |y| + |z|)
  Vec x, y;            // the direction's on the octahedron, before the lower half is folded out
  Mask upper;
};

RINGLIGHT_INLINE Vec sign(Vec a) { return select(ge(a, Vec(0.f)), Vec(1.f), Vec(-1.f)); }

static inline OctahedralPoint octahedral(const Vec direction[3]) {
  OctahedralPoint at;
  const Vec extent = abs(direction[0]) + abs(direction[1]) + abs(direction[2]);
  at.inverse = Vec(1.f) / max(extent, Vec(convention::SMALLEST_LENGTH));
  at.x = direction[0] * at.inverse, at.y = direction[1] * at.inverse;
  at.upper = ge(direction[2], Vec(0.f));
  at.u = select(at.upper, at.x, (Vec(1.f) - abs(at.y)) * sign(at.x));
  at.v = select(at.upper, at.y, (Vec(1.f) - abs(at.x)) * sign(at.y));
  return at;
}

// From dL/du and dL/dv to dL/d(direction).
static inline void octahedral_gradient(const OctahedralPoint& at, const Vec direction[3], Vec of_u, Vec of_v,
                                       Vec gradient[3]) {
  const Vec both = sign(at.x) * sign(at.y);
  const Vec of_x = select(at.upper, of_u, -both * of_v), of_y = select(at.upper, of_v, -both * of_u);
  const Vec radial = fma(of_x, at.x, of_y * at.y);
  gradient[0] = at.inverse * fnma(sign(direction[0]), radial, of_x);
  gradient[1] = at.inverse * fnma(sign(direction[1]), radial, of_y);
  gradient[2] = -at.inverse * sign(direction[2]) * radial;
}

}  // namespace ringlight::RINGLIGHT_ISA
