// Volumes: samples along rays, density and appearance as planes times lines or as three lines, a network for colour,
// and the way back.
// TensoRF (Chen et al., ECCV 2022). What is a sum over samples has a fixed order, whatever the number of threads.
#pragma once
#include <cstddef>
#include <cstdint>

#include "convention.hpp"
#include "simd/dispatch.hpp"

namespace ringlight {

// A plane's columns, its rows, and the line that goes with it.
constexpr int VOLUME_PAIRS = 3, VOLUME_PAIR_AXES[VOLUME_PAIRS][3] = {{0, 1, 2}, {0, 2, 1}, {1, 2, 0}};

// Origins, unit directions [count 3] and jitter [count].
struct VolumeRays {
  const float *origins, *directions, *jitter;
  std::size_t count;
};

// A box, samples of `step` world units, at most `most` a ray; and cells over a box of their own, whose bits, along z,
// say which are not known to be empty.
struct VolumeSpace {
  float low[3], high[3], cells_low[3], cells_high[3];
  const std::uint8_t* bits;
  int cells[3];
  float step;
  int most;
};

// Planes [S_b S_a C] and lines [S_c C] for the axes (x y, z), (x z, y), (y z, x), which have C components each. Or no
// planes, and lines [S C] for x, y and z, whose products are C components in all. C is a multiple of 16.
template <class Float>
struct VolumeFactors {
  Float *planes[3], *lines[3];
  int sides[3];
  int components;

  bool has_planes() const { return planes[0]; }
  int width() const { return has_planes() ? 3 * components : components; }  // components of a place
};

// Of all rays the samples from offsets[r] to offsets[r + 1]: places [M 3] in the box's [0, 1]^3, `along` the ray,
// `weights` of what is seen, light that is `left` behind a sample, and the `slopes` of a sample's thickness by what
// softplus is taken of.
struct VolumeSamples {
  float *places, *along, *weights, *left, *slopes;
};

struct VolumeOptics {
  float shift, optical, shown, end;  // of density before softplus; thickness of a step; least weight; light that ends
};

// Linear layers: basis [features components], null where features are given, then weight [outputs inputs] and bias of
// three layers.
template <class Float>
struct VolumeNetwork {
  Float *basis, *weights[3], *biases[3];
};

struct VolumeShape {
  int features, hidden;
};

// What is shown: S rows, by the ray that each is of.
struct VolumeRows {
  const std::int32_t* rays;
  std::size_t count;
};

// What the network sees of a row: `features` [S features], or the basis times the components at its sample's place.
struct VolumeSeen {
  const float* features;
  VolumeFactors<const float> factors;
  const float* places;
  const std::int32_t* samples;
};

#define RINGLIGHT_VOLUME(isa) \
  namespace isa { \
  void volume_count(const VolumeRays&, const VolumeSpace&, std::int32_t* counts); \
  void volume_march(const VolumeRays&, const VolumeSpace&, const VolumeFactors<const float>&, const VolumeOptics&, \
                    const std::int64_t* offsets, const VolumeSamples&, std::int32_t* shown, float* alpha, \
                    float* depth); \
  void volume_place(const VolumeRays&, const VolumeSpace&, const std::int64_t* offsets, const VolumeSamples&); \
  void volume_weigh(std::size_t rays, const std::int64_t* offsets, const float* densities, const VolumeOptics&, \
                    const VolumeSamples&, std::int32_t* shown, float* alpha, float* depth); \
  void volume_density(const VolumeFactors<const float>&, const float* places, std::size_t count, float* density); \
  void volume_blend(std::size_t rays, const std::int64_t* offsets, const std::int64_t* shown_offsets, \
                    const float* weights, float least, const float* colors, const float* alpha, \
                    const float* background, float* blended); \
  void volume_unblend(std::size_t rays, const std::int64_t* offsets, const std::int64_t* shown_offsets, \
                      const VolumeSamples&, float least, const float* colors, const float* background, \
                      const float* grad_color, const float* grad_alpha, const float* grad_depth, \
                      float* grad_colors, float* grad_density); \
  /* Which rows of gradient [count width] hand it on, rising, and what each counts: of those that have one at most \
     `share` are expected, drawn by importance. Rows and weights have room for all; returns how many. */ \
  std::size_t volume_draw(const float* gradient, std::size_t count, int width, double share, std::int32_t* rows, \
                          float* weights); \
  void volume_scatter(const VolumeFactors<const float>& factors, const float* places, const std::int32_t* samples, \
                      std::size_t count, const float* gradient, bool by_component, \
                      const VolumeFactors<float>& gradients); \
  }
RINGLIGHT_EVERY_ISA(RINGLIGHT_VOLUME)
#undef RINGLIGHT_VOLUME

// `halves`: products of the network's layers may be of bfloat16. `hidden` is null, or has room for the units of
// both hidden layers [2 S hidden], which the way back then need not make again: of the same rows.
#define RINGLIGHT_VOLUME_SHADING(isa) \
  namespace isa { \
  void volume_shade(const VolumeShape&, const VolumeSeen&, const VolumeNetwork<const float>&, const VolumeRows&, \
                    const float* directions, bool halves, float* colors, float* hidden); \
  void volume_shade_gradient(const VolumeShape&, const VolumeSeen&, const VolumeNetwork<const float>&, \
                             const VolumeRows&, const float* directions, bool halves, const float* hidden, \
                             const float* grad_colors, float* grad_seen, const VolumeNetwork<float>& gradients); \
  }
RINGLIGHT_EVERY_ISA_AND_BF16(RINGLIGHT_VOLUME_SHADING)
#undef RINGLIGHT_VOLUME_SHADING

}  // namespace ringlight
