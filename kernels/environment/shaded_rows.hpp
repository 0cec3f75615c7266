// Gaussians that are shaded one by one under an environment that is blurred for each roughness
// (src/ringlight/color/shaded_gaussians.py is the reference).
//
// The blurred maps lie one behind another, each as colours with the texels around its faces (environment.hpp): those
// for mirrors by rising roughness, then that of diffuse light.
#pragma once
#include <cstddef>

#include "convention.hpp"
#include "environment/environment.hpp"
#include "environment/surface_channels.hpp"

namespace ringlight {

constexpr int PLAIN_WIDTH = 3, SURFACE_WIDTH = 7;  // channels: rgb; rgb, normal, depth

struct LightLevels {
  int count;  // of roughness, at least two
  int sides[convention::SHADED_MAX_LEVELS + 1];
  float roughness[convention::SHADED_MAX_LEVELS];
  std::size_t before(int level) const {
    std::size_t texels = 0;
    for (int i = 0; i < level; i++) texels += CubemapSize{sides[i]}.floats() / TEXEL;
    return texels;
  }
  std::size_t texels() const { return before(count + 1); }
};

// What is reflected of the tint, and what besides, by the cosine of the view and the roughness, [side side 2].
struct SpecularTable {
  int side;
  const float* shares;
};

struct ShadedRows {
  SurfaceRows surface;  // without strengths
  Camera camera;
  float smallest_length;  // of a direction that is normalised
  float smoothest;        // roughness of the logit minus infinity
  bool ambient;           // whether diffuse light is added
  int width;              // of the channels, one of the two above
  const float *bases, *tints, *roughness, *residuals;  // [N 3], [N 3] and [N] logits, [N 6]
};

// What has a gradient.
struct ShadedGradients {
  float *means, *quats, *bases, *tints, *roughness, *residuals;
};

// channels [N width]; maps [texels 4]; shards TEXEL_SHARDS blocks of the same.
#define RINGLIGHT_SHADED(isa) \
  namespace isa { \
  void shaded_forward(const ShadedRows&, const LightLevels&, const SpecularTable&, const float* maps, \
                      float* channels); \
  void shaded_backward(const ShadedRows&, const LightLevels&, const SpecularTable&, const float* maps, \
                       const float* of_channels, const ShadedGradients& to, float* shards); \
  /* The first of TEXEL_SHARDS blocks becomes the sum of all, in their order. */ \
  void add_shards(std::size_t floats, float* shards); \
  }
RINGLIGHT_EVERY_ISA(RINGLIGHT_SHADED)
#undef RINGLIGHT_SHADED

}  // namespace ringlight
