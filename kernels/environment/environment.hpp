// Deferred shading by a cubemap: color = rgb + strength (environment(reflected) - rgb), per pixel
// (src/ringlight/shade/environment.py is the reference).
//
// The cubemap is kept as colours with the texels around each face, four floats a texel of which the last is unused, so
// that the four neighbours of any direction are two pieces of eight floats.
#pragma once
#include <cstddef>
#include <cstdint>

#include "raster/camera.hpp"
#include "simd/dispatch.hpp"

namespace ringlight {

constexpr int FACES = 6;
constexpr int TEXEL = 4;  // floats
// The gradient of the texels is summed in so many parts, each of fixed rows of the picture, which are then added in
// order. More would be more memory to clear and to add than pixels to shade.
constexpr int TEXEL_SHARDS = 4;

// Places around the faces, and the three texels whose mean stands at each; both count face by face and row by row.
struct CubemapBorder {
  std::size_t count;
  const std::int64_t *places, *sources;  // [B], [B 3]
};

struct CubemapSize {
  int side;
  int wide() const { return side + 2; }
  std::size_t floats() const { return static_cast<std::size_t>(FACES) * wide() * wide() * TEXEL; }
};

struct EnvironmentView {
  Camera camera;
  float faintest;         // alpha of a pixel that is not shaded
  float shortest_normal;  // of those that are stretched to unit length
};

// Planes of a picture, [7 H W] and [H W]: rgb, normal, strength; alpha.
struct EnvironmentPlanes {
  const float *image, *alpha;
};

// logits [6 S S 3]; colours [6 S+2 S+2 4]; color and of_color [3 H W]; of_image [7 H W].
#define RINGLIGHT_ENVIRONMENT(isa) \
  namespace isa { \
  void cubemap_colors(const CubemapSize&, const CubemapBorder&, const float* logits, float* colors); \
  /* Of TEXEL_SHARDS blocks of gradients; the first one is changed. */ \
  void cubemap_gradient(const CubemapSize&, const CubemapBorder&, const float* colors, float* shards, \
                        float* of_logits); \
  void environment_forward(const EnvironmentView&, const CubemapSize&, const EnvironmentPlanes&, const float* colors, \
                           float* color); \
  void environment_backward(const EnvironmentView&, const CubemapSize&, const EnvironmentPlanes&, \
                            const float* colors, const float* of_color, float* of_image, float* shards); \
  }
RINGLIGHT_EVERY_ISA(RINGLIGHT_ENVIRONMENT)
#undef RINGLIGHT_ENVIRONMENT

}  // namespace ringlight
