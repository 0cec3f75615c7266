// Deferred shading: color = rgb + alpha mlp(cosine, latents, base, features, direction), once per pixel that is opaque
// enough. The surface is what was blended over alpha; the features are octahedral maps' in the direction, seen from the
// centre of a sphere, of the point where the reflected ray leaves it, times factors of the reflecting point, if there
// are axes for these (src/ringlight/shade/reflection.py is the reference).
//
// Nothing is kept between forward and backward: the backward pass recomputes, for a share of the pixels, above 0, that
// is importance-sampled. All pixels hand on the gradient of rgb that does not go by the network.
//
// In the backward pass buffers and their gradients are block by block (raster.hpp), only color_gradient is a picture's.
// `drawn` gets which pixels of each block were drawn, bits; only blocks that have any get gradients beyond that of rgb.
#pragma once
#include <cstddef>
#include <cstdint>

#include "convention.hpp"
#include "raster/camera.hpp"
#include "raster/tile_shader.hpp"
#include "simd/dispatch.hpp"

namespace ringlight {

struct ReflectionShape {
  int hidden, layers;  // width of the hidden layers; layers of weights, at least 2
  int latents, shells, features;
  int levels, sides[convention::REFLECTION_MAX_LEVELS];
  bool parallax, direction;  // whether there are spheres; whether the network sees the viewing direction
  bool depth_gradient;       // whether the reflecting point's gradient reaches depth and alpha
  int axis_nodes;            // of each axis of factors; 0: features are those of the direction alone
};

// static: every instruction set has its own copy, see simd/simd.isa.hpp.
static inline bool reads_depth(const ReflectionShape& shape) { return shape.parallax || shape.axis_nodes; }
static inline std::size_t level_size(const ReflectionShape& shape, int level) {
  return static_cast<std::size_t>(shape.sides[level]) * shape.sides[level] * shape.features;
}
// Where the latents, base colour, features and direction stand among the network's inputs, and how many these are.
constexpr int LATENTS_INPUT = 1;
static inline int base_input(const ReflectionShape& shape) { return LATENTS_INPUT + shape.latents; }
static inline int features_input(const ReflectionShape& shape) { return base_input(shape) + 3; }
static inline int feature_count(const ReflectionShape& shape) { return shape.shells * shape.levels * shape.features; }
// Factors at the nodes of the three axes, one for each feature.
static inline std::size_t axes_size(const ReflectionShape& shape) {
  return static_cast<std::size_t>(3) * shape.axis_nodes * feature_count(shape);
}
static inline int direction_input(const ReflectionShape& shape) { return features_input(shape) + feature_count(shape); }
static inline int network_inputs(const ReflectionShape& shape) { return direction_input(shape) + 3 * shape.direction; }

// Parameters, or where their gradients go.
template <class Float>
struct ReflectionParameters {
  // [side side features], row j, column i for node (i, j)
  Float* maps[convention::REFLECTION_MAX_SHELLS][convention::REFLECTION_MAX_LEVELS];
  Float* sphere;                                              // [shells 4]: centre, log of the inverse radius; or null
  Float* axes;                                                // [3 nodes feature_count]; or null
  struct {
    Float *weight, *bias;  // [outputs inputs], [outputs]
  } mlp[convention::REFLECTION_MAX_LAYERS];
};

// Planes one after another, or blocks of sixteen pixels that have the channels of each side by side. Values, or where
// gradients go; depth may be null without spheres and axes, and its gradient where it is not wanted.
template <class Float>
struct ReflectionBuffers {
  Float *rgb, *normal, *latents, *depth, *alpha;
  std::size_t plane;       // from a channel to the next: floats
  std::size_t block = 16;  // from sixteen pixels to the next sixteen
};

// Lengths are in half sides of the scene's box.
struct ReflectionView {
  Camera camera;
  float origin[3], scale;                  // the optical centre; the length of a unit of depth
  float background[3];                     // what rgb lies over
  float faintest;                          // pixels of no more alpha are left alone
  float shortest_normal;                   // shorter ones are not stretched to unit length any more
  float smallest_chord;                    // the least square of half the chord that a ray cuts out of a sphere
};

// Shades tiles while a picture is blended. The channels are rgb, normal, latents and, if it is read, depth.
struct ReflectionShading : TileShader {
  ReflectionShape shape;
  ReflectionParameters<const float> parameters;
  ReflectionView view;
  bool exact;  // the bits of reflection_forward: no layer in bytes
  const void* tables;
};
static inline int shaded_channels(const ReflectionShape& shape) {
  return 3 + 3 + shape.latents + (reads_depth(shape) ? 1 : 0);
}

#define RINGLIGHT_REFLECTION(isa) \
  namespace isa { \
  void reflection_forward(const ReflectionShape&, const ReflectionParameters<const float>&, const ReflectionView&, \
                          const ReflectionBuffers<const float>&, float* color); \
  void reflection_backward(const ReflectionShape&, const ReflectionParameters<const float>&, const ReflectionView&, \
                           const ReflectionBuffers<const float>&, const float* color_gradient, double share, \
                           const ReflectionParameters<float>& gradients, \
                           const ReflectionBuffers<float>& buffer_gradients, std::int32_t* drawn); \
  std::size_t reflection_room(const ReflectionShading&);   /* bytes for reflection_prepare */ \
  void reflection_prepare(ReflectionShading&, void* room); /* from shape and parameters to all that is not view */ \
  }
RINGLIGHT_EVERY_ISA_AND_BF16(RINGLIGHT_REFLECTION)
#undef RINGLIGHT_REFLECTION

}  // namespace ringlight
