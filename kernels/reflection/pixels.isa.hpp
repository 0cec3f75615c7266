// Sixteen covered pixels, one per lane: their surface, the ray that it reflects, and the gradients of both.
#pragma once
#include "reflection/lane_maps.isa.hpp"
#include "reflection/reflection.hpp"

namespace ringlight::RINGLIGHT_ISA {

// Which of sixteen pixels from `begin`, as far as there are as many before `end`, are opaque enough: bits.
RINGLIGHT_INLINE unsigned covered_lanes(const float* alpha, std::size_t begin, std::size_t end, float faintest) {
  const int left = end - begin < LANES ? static_cast<int>(end - begin) : LANES;
  const unsigned on = bits(gt(load_first(alpha + begin, left), Vec(faintest)));
  return on & ((1u << left) - 1);
}

// Sixteen pixels side by side: where they have their centres, and the first one's place in every row of values.
struct PixelLanes {
  Vec x, y;
  ReflectionBuffers<const float> values;
};

RINGLIGHT_INLINE Vec dot(const Vec a[3], const Vec b[3]) { return fma(a[0], b[0], fma(a[1], b[1], a[2] * b[2])); }

// What a pixel shows, and the ray that looks at it.
struct Surface {
  Vec inverse_alpha, depth;      // depth: camera z, world units
  Vec ray[3], direction[3];      // one unit of camera z long; of unit length
  Vec normal[3], stretch;        // normal = stretch * blended
  Mask stretched;                // whether the normal is of unit length
  Vec facing;                    // direction . normal
  Vec reflected[3], point[3];
};

static inline void set_ray(const ReflectionView& view, const PixelLanes& at, Surface& surface) {
  const Camera& camera = view.camera;
  const Vec across = (at.x - Vec(camera.center_x)) * Vec(1.f / camera.focal_x);
  const Vec down = (at.y - Vec(camera.center_y)) * Vec(1.f / camera.focal_y);
  const float* m = camera.world_to_camera;
  for (int c = 0; c < 3; c++) surface.ray[c] = fma(across, Vec(m[c]), fma(down, Vec(m[4 + c]), Vec(m[8 + c])));
  const Vec inverse = Vec(1.f) / sqrt(dot(surface.ray, surface.ray));
  for (int c = 0; c < 3; c++) surface.direction[c] = surface.ray[c] * inverse;
}

// The surface of sixteen pixels; its cosine, latents and base colour go to the network's inputs, [n][GROUP].
static inline void see(const ReflectionShape& shape, const ReflectionView& view, const PixelLanes& at,
                       Surface& surface, float* inputs) {
  set_ray(view, at, surface);
  const ReflectionBuffers<const float>& values = at.values;
  const Vec inverse = Vec(1.f) / load(values.alpha);
  surface.inverse_alpha = inverse;
  surface.depth = reads_depth(shape) ? load(values.depth) * inverse : Vec(0.f);
  Vec blended[3];
  for (int c = 0; c < 3; c++) {
    blended[c] = load(values.normal + c * values.plane);
    surface.point[c] = fma(surface.depth * Vec(view.scale), surface.ray[c], Vec(view.origin[c]));
    const Vec behind(view.background[c]);
    const Vec shown = load(values.rgb + c * values.plane);
    store(inputs + (base_input(shape) + c) * GROUP, fma(shown - behind, inverse, behind));
    if (shape.direction) store(inputs + (direction_input(shape) + c) * GROUP, surface.direction[c]);
  }
  for (int i = 0; i < shape.latents; i++)
    store(inputs + (LATENTS_INPUT + i) * GROUP, load(values.latents + i * values.plane) * inverse);
  const Vec length = sqrt(dot(blended, blended)), shortest(view.shortest_normal);
  surface.stretched = gt(length, shortest);
  surface.stretch = Vec(1.f) / max(length, shortest);
  for (int c = 0; c < 3; c++) surface.normal[c] = blended[c] * surface.stretch;
  surface.facing = dot(surface.direction, surface.normal);
  store(inputs, -surface.facing);
  for (int c = 0; c < 3; c++)
    surface.reflected[c] = fnma(surface.facing + surface.facing, surface.normal[c], surface.direction[c]);
}

// Where the reflected ray leaves a shell.
struct Exit {
  Vec local[3];                 // the reflecting point from the centre, in radii
  Vec along, half_chord, distance;
  Mask hits;                    // whether the chord is longer than the least
  Vec direction[3];
  OctahedralPoint on_map;
};

static inline void leave(const Surface& surface, const float* sphere, float scale, float smallest_chord, Exit& exit) {
  if (sphere == nullptr) {
    for (int c = 0; c < 3; c++) exit.direction[c] = surface.reflected[c];
  } else {
    for (int c = 0; c < 3; c++) exit.local[c] = (surface.point[c] - Vec(sphere[c])) * Vec(scale);
    exit.along = dot(exit.local, surface.reflected);
    const Vec squared = fma(exit.along, exit.along, Vec(1.f) - dot(exit.local, exit.local));
    exit.hits = gt(squared, Vec(smallest_chord));
    exit.half_chord = sqrt(max(squared, Vec(smallest_chord)));
    exit.distance = exit.half_chord - exit.along;
    for (int c = 0; c < 3; c++) exit.direction[c] = fma(exit.distance, surface.reflected[c], exit.local[c]);
  }
  exit.on_map = octahedral(exit.direction);
}

// Gradients of a surface, collected over the shells.
struct SurfaceGradient {
  Vec reflected[3], point[3];
};

// From dL/d(exit.direction); adds to the surface's gradient, and lane by lane to that of the sphere, [4][LANES].
static inline void leave_gradient(const Surface& surface, const Exit& exit, float scale, bool parallax,
                                  const Vec of_direction[3], SurfaceGradient& gradient, float* of_sphere) {
  if (!parallax) {
    for (int c = 0; c < 3; c++) gradient.reflected[c] += of_direction[c];
    return;
  }
  const Vec of_distance = dot(of_direction, surface.reflected);
  const Vec of_squared = keep(exit.hits, of_distance * Vec(0.5f) / exit.half_chord), twice = of_squared + of_squared;
  const Vec of_along = fma(twice, exit.along, -of_distance);
  Vec of_size(0.f);
  for (int c = 0; c < 3; c++) {
    const Vec of_local = fnma(twice, exit.local[c], fma(of_along, surface.reflected[c], of_direction[c]));
    gradient.reflected[c] += fma(exit.distance, of_direction[c], of_along * exit.local[c]);
    const Vec of_offset = of_local * Vec(scale);
    gradient.point[c] += of_offset;
    store(of_sphere + c * LANES, load(of_sphere + c * LANES) - of_offset);
    of_size = fma(of_local, exit.local[c], of_size);
  }
  store(of_sphere + 3 * LANES, load(of_sphere + 3 * LANES) + of_size);
}

// The gradients that the network has no part in: dL/dcolor, and dL/dalpha as the factor of what is added.
struct Upstream {
  Vec color[3], alpha;
};

// From the gradients of the network's inputs, [n][GROUP], and of the reflection, to those of the planes.
static inline void see_gradient(const ReflectionShape& shape, const ReflectionView& view, const Surface& surface,
                                const SurfaceGradient& gradient, const Upstream& upstream,
                                const float* inputs, const float* of_inputs, const ReflectionBuffers<float>& to) {
  const Vec inverse = surface.inverse_alpha;
  Vec of_alpha = upstream.alpha, of_mean(0.f);
  for (int c = 0; c < 3; c++) {
    const int i = (base_input(shape) + c) * GROUP;
    store(to.rgb + c * to.plane, fma(load(of_inputs + i), inverse, upstream.color[c]));
    of_mean = fma(load(of_inputs + i), load(inputs + i) - Vec(view.background[c]), of_mean);
  }
  for (int k = 0; k < shape.latents; k++) {
    const int i = (LATENTS_INPUT + k) * GROUP;
    store(to.latents + k * to.plane, load(of_inputs + i) * inverse);
    of_mean = fma(load(of_inputs + i), load(inputs + i), of_mean);
  }
  if (shape.depth_gradient) {
    const Vec of_depth = dot(gradient.point, surface.ray) * Vec(view.scale);
    store(to.depth, of_depth * inverse);
    of_mean = fma(of_depth, surface.depth, of_mean);
  }
  store(to.alpha, fnma(of_mean, inverse, of_alpha));
  const Vec of_normal_part = dot(gradient.reflected, surface.normal);
  const Vec of_facing = -(of_normal_part + of_normal_part) - load(of_inputs);
  const Vec twice = surface.facing + surface.facing;
  Vec of_normal[3];
  for (int c = 0; c < 3; c++)
    of_normal[c] = fnma(twice, gradient.reflected[c], of_facing * surface.direction[c]);
  const Vec radial = keep(surface.stretched, dot(of_normal, surface.normal));
  for (int c = 0; c < 3; c++)
    store(to.normal + c * to.plane, surface.stretch * fnma(radial, surface.normal[c], of_normal[c]));
}

}  // namespace ringlight::RINGLIGHT_ISA
