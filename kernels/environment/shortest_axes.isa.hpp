// Sixteen Gaussians' shortest axes, turned towards the camera, and the way back to their quaternions.
#pragma once
#include "environment/surface_channels.hpp"
#include "simd/row_columns.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

// Sixteen rotations whose axes are counted from the shortest one, k: a column of a rotation matrix is then the same
// expression whichever it is.
struct ShortestAxes {
  Mask is_x, is_y;            // whether k is 0, or 1
  Vec w, a, b, c;             // of the unit quaternion: its real part, and the others from k on
  Vec inverse;                // of the stored quaternion's length
  Mask has_length;
  Vec sign;                   // -1 where the axis looks away from the camera

  // From the order k, k + 1, k + 2 to x, y, z, and back.
  void in_world(const Vec from[3], Vec to[3]) const {
    to[0] = select(is_x, from[0], select(is_y, from[2], from[1]));
    to[1] = select(is_x, from[1], select(is_y, from[0], from[2]));
    to[2] = select(is_x, from[2], select(is_y, from[1], from[0]));
  }
  void from_shortest(const Vec from[3], Vec to[3]) const {
    to[0] = select(is_x, from[0], select(is_y, from[1], from[2]));
    to[1] = select(is_x, from[1], select(is_y, from[2], from[0]));
    to[2] = select(is_x, from[2], select(is_y, from[0], from[1]));
  }
};

// The axes in the world go to `normal`.
static inline ShortestAxes shortest_axes(const SurfaceRows& rows, std::size_t first, int count, Vec normal[3]) {
  Vec means[LANES], scales[LANES], quats[LANES], vector[3], axis[3];
  take_columns(rows.means + 3 * first, 3, count, means);
  take_columns(rows.log_scales + 3 * first, 3, count, scales);
  take_columns(rows.quats + 4 * first, 4, count, quats);
  ShortestAxes found;
  found.is_x = both(ge(scales[1], scales[0]), ge(scales[2], scales[0]));
  found.is_y = ge(scales[2], scales[1]);
  Vec squared = quats[0] * quats[0];
  for (int i = 1; i < 4; i++) squared = fma(quats[i], quats[i], squared);
  const Vec length = sqrt(squared), least(rows.smallest_length);
  found.has_length = gt(length, least);
  found.inverse = Vec(1.f) / max(length, least);
  for (int c = 0; c < 3; c++) quats[c + 1] = quats[c + 1] * found.inverse;
  found.w = quats[0] * found.inverse;
  found.from_shortest(quats + 1, vector);
  found.a = vector[0], found.b = vector[1], found.c = vector[2];
  const Vec two(2.f);
  axis[0] = fnma(two, fma(found.b, found.b, found.c * found.c), Vec(1.f));
  axis[1] = two * fma(found.a, found.b, found.w * found.c);
  axis[2] = two * fnma(found.w, found.b, found.a * found.c);
  found.in_world(axis, normal);
  Vec facing(0.f);
  for (int c = 0; c < 3; c++) facing = fma(Vec(rows.position[c]) - means[c], normal[c], facing);
  found.sign = select(ge(facing, Vec(0.f)), Vec(1.f), Vec(-1.f));
  for (int c = 0; c < 3; c++) normal[c] = normal[c] * found.sign;
  return found;
}

// dL/d(quaternion as stored) from dL/d(normal): w, x, y, z.
static inline void quaternion_gradient(const ShortestAxes& axes, const Vec of_normal[3], Vec of_quat[LANES]) {
  Vec g[3], of_vector[3];
  axes.from_shortest(of_normal, g);
  for (int c = 0; c < 3; c++) g[c] = g[c] * axes.sign * Vec(2.f);
  const Vec twice = g[0] + g[0];
  of_quat[0] = fnma(axes.b, g[2], axes.c * g[1]);
  of_vector[0] = fma(axes.b, g[1], axes.c * g[2]);
  of_vector[1] = fnma(axes.b, twice, fnma(axes.w, g[2], axes.a * g[1]));
  of_vector[2] = fnma(axes.c, twice, fma(axes.w, g[1], axes.a * g[2]));
  const Vec vector[3] = {axes.a, axes.b, axes.c};
  Vec radial = of_quat[0] * axes.w;
  for (int c = 0; c < 3; c++) radial = fma(of_vector[c], vector[c], radial);
  radial = keep(axes.has_length, radial);
  of_quat[0] = axes.inverse * fnma(radial, axes.w, of_quat[0]);
  for (int c = 0; c < 3; c++) of_vector[c] = axes.inverse * fnma(radial, vector[c], of_vector[c]);
  axes.in_world(of_vector, of_quat + 1);
}

}  // namespace ringlight::RINGLIGHT_ISA
