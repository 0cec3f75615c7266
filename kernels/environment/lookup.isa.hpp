// Sixteen pixels, one per lane: what they reflect of the cubemap, and the gradients of it.
#pragma once
#include <cstdint>

#include "convention.hpp"
#include "environment/environment.hpp"
#include "simd/simd.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

constexpr int RGB = 0, NORMAL = 3, STRENGTH = 6;  // planes of a picture
constexpr int NEIGHBOURS = 4;                     // of a direction: above left and right, below left and right

RINGLIGHT_INLINE Vec inner(const Vec a[3], const Vec b[3]) { return fma(a[0], b[0], fma(a[1], b[1], a[2] * b[2])); }

// The ray that a pixel's centre sees, its blended normal, and the ray reflected.
struct Mirror {
  Vec direction[3], normal[3], stretch, facing, reflected[3];  // normal = stretch * blended; facing = direction.normal
  Mask stretched;                                              // whether the normal is of unit length
};

static inline Mirror mirror(const EnvironmentView& view, Vec x, float y, const Vec blended[3]) {
  const Camera& camera = view.camera;
  const Vec across = (x - Vec(camera.center_x)) * Vec(1.f / camera.focal_x);
  const Vec down((y - camera.center_y) * (1.f / camera.focal_y));
  const float* m = camera.world_to_camera;
  Mirror found;
  for (int c = 0; c < 3; c++) found.direction[c] = fma(across, Vec(m[c]), fma(down, Vec(m[4 + c]), Vec(m[8 + c])));
  const Vec inverse = Vec(1.f) / sqrt(inner(found.direction, found.direction));
  for (int c = 0; c < 3; c++) found.direction[c] = found.direction[c] * inverse;
  const Vec length = sqrt(inner(blended, blended)), shortest(view.shortest_normal);
  found.stretched = gt(length, shortest);
  found.stretch = Vec(1.f) / max(length, shortest);
  for (int c = 0; c < 3; c++) found.normal[c] = blended[c] * found.stretch;
  found.facing = inner(found.direction, found.normal);
  for (int c = 0; c < 3; c++)
    found.reflected[c] = fnma(found.facing + found.facing, found.normal[c], found.direction[c]);
  return found;
}

// dL/d(blended normal) from dL/d(reflected).
RINGLIGHT_INLINE void mirror_gradient(const Mirror& of, const Vec of_reflected[3], Vec of_blended[3]) {
  const Vec part = inner(of_reflected, of.normal), twice = of.facing + of.facing;
  for (int c = 0; c < 3; c++) of_blended[c] = fnma(twice, of_reflected[c], -(part + part) * of.direction[c]);
  const Vec radial = keep(of.stretched, inner(of_blended, of.normal));
  for (int c = 0; c < 3; c++) of_blended[c] = of.stretch * fnma(radial, of.normal[c], of_blended[c]);
}

// Which faces each lane looks at: their side, and the texels that come before them.
struct LaneFaces {
  Vec side, before;
  alignas(64) std::int32_t next_row[LANES];  // floats
};

// Where directions fall on the cube, and the colours around each place.
struct Looked {
  Mask is_x, is_y;                          // the longest coordinate's axis; z if neither
  Vec along, inverse, a, b;                 // that coordinate, 1 / |along|, and the two others over it
  Vec right, below;                         // shares of the neighbours on these sides
  Vec half;                                 // of a side
  alignas(64) std::int32_t first[LANES];    // float at which the neighbour above left begins
  Vec texels[NEIGHBOURS * TEXEL];           // [neighbour][channel]
};

// Lanes whose bit of `on` is off see the first texels of all.
static inline void look(const LaneFaces& faces, const float* colors, const Vec direction[3], unsigned on,
                        Looked& found) {
  const Vec x = abs(direction[0]), y = abs(direction[1]), z = abs(direction[2]);
  found.is_x = both(ge(x, y), ge(x, z));
  found.is_y = ge(y, z);
  const auto by_axis = [&](Vec of_x, Vec of_y, Vec of_z) {
    return select(found.is_x, of_x, select(found.is_y, of_y, of_z));
  };
  found.along = by_axis(direction[0], direction[1], direction[2]);
  found.inverse = Vec(1.f) / max(Vec(convention::SMALLEST_LENGTH), by_axis(x, y, z));  // NaN stays
  found.a = by_axis(direction[1], direction[0], direction[0]) * found.inverse;
  found.b = by_axis(direction[2], direction[2], direction[1]) * found.inverse;
  found.half = Vec(0.5f) * faces.side;
  const Vec across = fma(found.a + Vec(1.f), found.half, Vec(0.5f));
  const Vec down = fma(found.b + Vec(1.f), found.half, Vec(0.5f));
  // In this order what is not a number becomes 0.
  const Vec column = min(max(floor(across), Vec(0.f)), faces.side);
  const Vec row = min(max(floor(down), Vec(0.f)), faces.side);
  found.right = across - column, found.below = down - row;
  const Vec face = by_axis(Vec(0.f), Vec(2.f), Vec(4.f)) + keep(lt(found.along, Vec(0.f)), Vec(1.f));
  const Vec wide = faces.side + Vec(2.f);
  const Vec texel = fma(fma(face, wide, row), wide, column) + faces.before;  // below 2^24, hence exact
  store(found.first, truncate(keep(mask_from_bits(on), texel) * Vec(static_cast<float>(TEXEL))));
  for (int i = 0; i < LANES; i++) {
    const float *at = colors + found.first[i], *under = at + faces.next_row[i];
    found.texels[i] = load_quarters(at, at + TEXEL, under, under + TEXEL);
  }
  transpose(found.texels);
}

static inline LaneFaces same_faces(const CubemapSize& size) {
  LaneFaces faces{Vec(static_cast<float>(size.side)), Vec(0.f), {}};
  for (int i = 0; i < LANES; i++) faces.next_row[i] = size.wide() * TEXEL;
  return faces;
}

RINGLIGHT_INLINE Vec texel(const Looked& of, int neighbour, int channel) {
  return of.texels[neighbour * TEXEL + channel];
}

RINGLIGHT_INLINE Vec seen(const Looked& of, int channel) {
  const Vec above = fma(of.right, texel(of, 1, channel) - texel(of, 0, channel), texel(of, 0, channel));
  const Vec under = fma(of.right, texel(of, 3, channel) - texel(of, 2, channel), texel(of, 2, channel));
  return fma(of.below, under - above, above);
}

// dL/d(direction) from dL/d(what is seen).
static inline void look_gradient(const Looked& of, const Vec of_seen[3], Vec of_direction[3]) {
  Vec of_right(0.f), of_below(0.f);
  for (int c = 0; c < 3; c++) {
    const Vec top = texel(of, 1, c) - texel(of, 0, c), bottom = texel(of, 3, c) - texel(of, 2, c);
    const Vec left = texel(of, 2, c) - texel(of, 0, c);
    of_right = fma(of_seen[c], fma(of.below, bottom - top, top), of_right);
    of_below = fma(of_seen[c], fma(of.right, bottom - top, left), of_below);
  }
  const Vec scale = of.half * of.inverse;
  const Vec of_a = of_right * scale, of_b = of_below * scale;
  const Vec of_length = -fma(of_a, of.a, of_b * of.b);
  const Vec of_along = select(lt(of.along, Vec(0.f)), -of_length, of_length);
  of_direction[0] = select(of.is_x, of_along, of_a);
  of_direction[1] = select(of.is_x, of_a, select(of.is_y, of_along, of_b));
  of_direction[2] = select(of.is_x, of_b, select(of.is_y, of_b, of_along));
}

// A texel is added as a whole: the next pixel usually reads what was just written, and waits for it several times as
// long where that was written in other parts than it is read in.
using TexelVec = float __attribute__((vector_size(16)));
using TexelInMemory = float __attribute__((vector_size(16), aligned(4), may_alias));

RINGLIGHT_INLINE void add_texel(float* to, const float* from) {
  const TexelVec sum = *reinterpret_cast<const TexelInMemory*>(to) + *reinterpret_cast<const TexelInMemory*>(from);
  *reinterpret_cast<TexelInMemory*>(to) = sum;
}

// Adds dL/d(what is seen), of the lanes whose bit of `on` is on, to those of the texels around.
static inline void texel_gradient(const LaneFaces& faces, const Looked& of, const Vec of_seen[3], unsigned on,
                                  float* to) {
  const Vec one(1.f), left = one - of.right, above = one - of.below;
  const Vec shares[NEIGHBOURS] = {left * above, of.right * above, left * of.below, of.right * of.below};
  Vec rows[LANES];
  for (int n = 0; n < NEIGHBOURS; n++) {
    for (int c = 0; c < 3; c++) rows[n * TEXEL + c] = shares[n] * of_seen[c];
    rows[n * TEXEL + 3] = Vec(0.f);
  }
  transpose(rows);
  alignas(64) float values[LANES][LANES];
  for (int i = 0; i < LANES; i++) store(values[i], rows[i]);
  for (; on; on &= on - 1) {
    const int i = __builtin_ctz(on);
    float *at = to + of.first[i], *under = at + faces.next_row[i];
    add_texel(at, values[i]);
    add_texel(at + TEXEL, values[i] + TEXEL);
    add_texel(under, values[i] + 2 * TEXEL);
    add_texel(under + TEXEL, values[i] + 3 * TEXEL);
  }
}

}  // namespace ringlight::RINGLIGHT_ISA
