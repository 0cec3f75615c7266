// What Gaussians emit for a deferred reflection, row by row as the rasterizer takes it: base colour, shortest axis
// turned towards the camera, strength (src/ringlight/color/reflective_harmonics.py is the reference).
#pragma once
#include <cstddef>

#include "simd/dispatch.hpp"

namespace ringlight {

struct SurfaceRows {
  std::size_t count;
  const float *means, *log_scales, *quats, *strengths;  // [N 3], [N 3], [N 4] of any length, [N] logits
  const float* position;                                // of the camera, 3
  float smallest_length;                                // of a quaternion that is normalised
};

// What has a gradient, [N 3], [N 4], [N].
struct SurfaceGradients {
  float *colors, *quats, *strengths;
};

// colors [N 3], channels [N 7].
#define RINGLIGHT_SURFACE(isa) \
  namespace isa { \
  void surface_channels(const SurfaceRows&, const float* colors, float* channels); \
  void surface_gradient(const SurfaceRows&, const float* of_channels, const SurfaceGradients& to); \
  }
RINGLIGHT_EVERY_ISA(RINGLIGHT_SURFACE)
#undef RINGLIGHT_SURFACE

}  // namespace ringlight
