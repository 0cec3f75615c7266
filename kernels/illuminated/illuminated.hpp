// What light adds to Gaussians in 3iGS: tanh MLP(tanh f, tanh L(p), v, IDE(v, roughness)), with L planes times lines
// that a matrix mixes (src/ringlight/color/illuminated.py is the reference).
//
// Nothing is kept between forward and backward, which computes again what it needs: fewer rows have a gradient.
#pragma once
#include <cstddef>
#include <cstdint>

#include "dense/perceptron.hpp"
#include "encoding/directional_encoding.hpp"
#include "planes/planes.hpp"
#include "simd/dispatch.hpp"

namespace ringlight {

constexpr int VIEW_WIDTH = 3 + CODE_WIDTH;  // of the network's inputs, those that come with the view
constexpr int LIT_WIDTH = 3;                // of its results: rgb

struct LightField {
  PlaneShape shape;
  PlaneGrids<const float> grids;
  int features;               // of the field, and of each Gaussian
  const float *mix, *offset;  // [features 3C], [features]
  PerceptronShape network;    // one head, no nodes; inputs: a Gaussian's features, the field's, the view
  PerceptronLayers<const float> layers;
  const float* polynomials;   // of the encoding
  int joined() const { return PLANE_PAIRS * shape.channels; }
};

struct LitGaussians {
  std::size_t count;
  const std::int32_t* rows;                   // [count], of the columns
  const float *means, *roughness, *features;  // columns [N 3], [N] as stored, [N features]
  float low[3], scale[3];                     // a place's coordinates in the field: (mean - low) scale - 1
  float position[3];                          // of the camera
  float smallest_length;                      // of a direction that is normalised
  float roughness_shift;                      // roughness = softplus(stored - shift)
};

// Where gradients go. Columns as above, of which the lit rows are written; points [count 3] in the field's coordinates
// and what their products get, [count 3C], are for plane_gradient.
struct LightGradients {
  float *roughness, *features;
  PerceptronLayers<float> layers;
  float *mix, *offset, *points, *products;
};

// specular [count 3], its gradient likewise.
#define RINGLIGHT_ILLUMINATED(isa) \
  namespace isa { \
  void light_forward(const LightField&, const LitGaussians&, float* specular); \
  void light_backward(const LightField&, const LitGaussians&, const float* of_specular, const LightGradients&); \
  /* Of upstream [count 3]: which of its rows are drawn, and what they count; returns how many. */ \
  std::size_t draw_lit_rows(double share, std::size_t count, const float* upstream, std::int32_t* drawn, \
                            float* weights); \
  }
RINGLIGHT_EVERY_ISA_AND_BF16(RINGLIGHT_ILLUMINATED)
#undef RINGLIGHT_ILLUMINATED

}  // namespace ringlight
