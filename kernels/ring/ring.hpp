// RingLight's light field: from a Gaussian's centre and base colour to its colour (RingLight-GS, eq. 5, 7 and 8).
//
//   a = tanh(core . vec(H_x H_y H_z H_v)), H_x, H_y, H_z between nodes on [-1, 1], H_v on an octahedral map
//   (the diagonal ring: products of R^2 components instead of R x R matrices)
//   m = sigmoid(modulation(v, a)),  r = tanh(render(a, m, b, l)),  color = clamp(b + r, 0, 1),  b = sigmoid(base)
//   (modulation as a factor: r = m tanh(render(a, b, l)); a shape may also want colours that are not clamped)
//
// and l the Gaussian's latents, values of its own that have no other meaning; the paper has none.
//
// Nothing is kept between forward and backward: the backward pass recomputes, for rows with a gradient only, and of
// these for a share.
#pragma once
#include <cstddef>
#include <cstdint>

#include "convention.hpp"
#include "raster/camera.hpp"
#include "simd/dispatch.hpp"

namespace ringlight {

struct RingShape {
  int rank, features;
  int render_hidden, modulation_hidden;  // modulation_hidden 0: no light modulation
  int nodes, view_nodes;                 // of each axis; on each side of the octahedral map
  int latents;                           // of each Gaussian; may be 0
  bool diagonal;                         // the matrices are diagonal, with R^2 components
  bool factor;                           // m weighs the residual and is no input of the render network
  bool clamped;                          // colours are clamped to [0, 1]
};

// static: every instruction set has its own copy, see simd/simd.isa.hpp.
static inline std::size_t matrix_size(const RingShape& shape) {
  return static_cast<std::size_t>(shape.rank) * shape.rank;
}
static inline std::size_t axis_size(const RingShape& shape) { return shape.nodes * matrix_size(shape); }
static inline std::size_t view_size(const RingShape& shape) {
  return static_cast<std::size_t>(shape.view_nodes) * shape.view_nodes * matrix_size(shape);
}
static inline bool modulated(const RingShape& shape) { return shape.modulation_hidden > 0; }
static inline bool weighed(const RingShape& shape) { return modulated(shape) && shape.factor; }
static inline int modulation_inputs(const RingShape& shape) { return 3 + shape.features; }
// Where the base colour stands among the render network's inputs, and how many these are.
static inline int base_input(const RingShape& shape) {
  return shape.features + (modulated(shape) && !shape.factor);
}
static inline int render_inputs(const RingShape& shape) { return base_input(shape) + 3 + shape.latents; }

// [outputs inputs] and [outputs].
template <class Float>
struct RingLayer {
  Float *weight, *bias;
};

// Parameters, or where their gradients go.
template <class Float>
struct RingParameters {
  Float *axes, *view, *core;  // [3 nodes R^2], [view_nodes^2 R^2] with row j * side + i for node (i, j), [C R^2]
  RingLayer<Float> modulation[2], render[3];
};

struct RingScene {
  const float *means, *base;     // [count 3] world, [count 3] logits
  const float* latents;          // [count shape.latents]
  std::size_t count;
  const std::int32_t* visible;   // the rows that are lit
  std::size_t visible_count;
  float camera[3], low[3], high[3];  // world: the optical centre, the box that [-1, 1]^3 covers
};

// All [count 3] but modulation [count 1]; residual and modulation may be null. Rows that are not lit get their base
// colour, and nothing in the other two.
struct RingOutputs {
  float *color, *residual, *modulation;
};

// What the backward pass is given: the forward pass's colours and dL/d(color), [count 3] each, and the share of the lit
// rows, above 0, whose light is differentiated. All rows get the gradient that does not go by the light.
struct RingUpstream {
  const float *color, *color_gradient;
  double share;
};

// The gradient of what each Gaussian has of its own: [count 3] by the logits, [count shape.latents].
struct RingRowGradients {
  float *base, *latents;
};

// Shards of the backward pass: a power of two, so that two, four or eight threads have equal shares, and few for few
// rows, because the sums of each hold a copy of the tables. A function of the number of rows alone: the order of
// summation must not depend on the machine.
static inline int ring_shards(std::size_t active_count) {
  return active_count <= 1024 ? 1 : active_count <= 8192 ? 2 : active_count <= 65536 ? 4 : 8;
}

// The light field for a blend that asks for rows one after the other (LazyColors): the scene, whose list of visible
// rows is not read, and what ring_pack made of the parameters.
struct PackedRing {
  RingShape shape;
  RingParameters<const float> parameters;
  RingScene scene;
  const float* packed;
};

// ring_pack fills in ring_packed_floats; ring_light writes the colours of some rows, [count 3], the same bits as
// ring_forward, with ring_light_floats to write to. ring_workspace: floats that ring_backward needs for so many visible
// rows.
#define RINGLIGHT_RING(isa) \
  namespace isa { \
  void ring_forward(const RingShape&, const RingParameters<const float>&, const RingScene&, const RingOutputs&); \
  void ring_backward(const RingShape&, const RingParameters<const float>&, const RingScene&, \
                     const RingUpstream&, const RingParameters<float>& gradients, \
                     const RingRowGradients& row_gradients, float* workspace); \
  std::size_t ring_workspace(const RingShape& shape, std::size_t visible_count); \
  std::size_t ring_packed_floats(const RingShape&); \
  void ring_pack(const RingShape&, const RingParameters<const float>&, float* packed); \
  std::size_t ring_light_floats(const RingShape&); \
  void ring_light(const void* packed_ring, const std::int32_t* rows, int count, float* colors, float* scratch); \
  }
RINGLIGHT_EVERY_ISA_AND_BF16(RINGLIGHT_RING)
#undef RINGLIGHT_RING

}  // namespace ringlight
