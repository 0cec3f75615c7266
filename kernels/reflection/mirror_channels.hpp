// What Gaussians emit for deferred shading, row by row as the rasterizer takes it: base colour, unit normal turned
// towards the camera, latents, depth (src/ringlight/color/mirror.py is the reference).
#pragma once
#include <cstddef>

#include "convention.hpp"
#include "raster/camera.hpp"
#include "simd/dispatch.hpp"

namespace ringlight {

template <class Float>
struct MirrorColumns {
  Float *means, *base, *normals, *latents;  // [N 3], [N 3] logits, [N 3] of any length, [N latents]
};

struct MirrorView {
  Camera camera;
  float flip_below;       // cosine to the camera below which a normal is turned round
  float smallest_length;  // of a normal that has a direction
};

// What harmonics make of the base colours, as sh_colors leaves it (step/sh.hpp), and where dL/d(a colour's constant
// coefficient) goes, [N 3], from which that of the harmonics is made; null where base colours have no harmonics.
struct VaryingColors {
  const float *colors, *slopes;
  float* by_constant;
};

struct MirrorScene : MirrorView {
  std::size_t count;
  int latents;
  VaryingColors varying;
};

// channels [N 7 + latents]. The backward pass returns whether any depth had a gradient, or base colours have harmonics;
// `to.means` is that of the depths and of the harmonics.
#define RINGLIGHT_MIRROR(isa) \
  namespace isa { \
  void mirror_channels(const MirrorScene&, const MirrorColumns<const float>&, float* channels); \
  bool mirror_gradient(const MirrorScene&, const MirrorColumns<const float>&, const float* of_channels, \
                       const MirrorColumns<float>& to); \
  }
RINGLIGHT_EVERY_ISA(RINGLIGHT_MIRROR)
#undef RINGLIGHT_MIRROR

}  // namespace ringlight
