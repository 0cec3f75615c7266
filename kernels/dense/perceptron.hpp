// H perceptrons of one shape with two hidden layers, each evaluated at K rows of its own: the ring's heads at the nodes
// of their tables. Nothing is kept between forward and backward.
#pragma once
#include <cstddef>

#include "simd/dispatch.hpp"

namespace ringlight {

struct PerceptronShape {
  int heads, nodes, inputs, hidden, outputs;
};

// By layer: weight [heads inputs outputs] and bias [heads outputs]. Values, or where gradients go.
template <class Float>
struct PerceptronLayers {
  Float *weight[3], *bias[3];
};

// rows [heads nodes inputs] to results [heads nodes outputs]. The rows' gradient goes to `of_rows` unless that is null.
#define RINGLIGHT_PERCEPTRON(isa) \
  namespace isa { \
  void perceptron_forward(const PerceptronShape&, const PerceptronLayers<const float>&, const float* rows, \
                          float* results); \
  void perceptron_backward(const PerceptronShape&, const PerceptronLayers<const float>&, const float* rows, \
                           const float* upstream, const PerceptronLayers<float>& gradients, float* of_rows); \
  }
RINGLIGHT_EVERY_ISA_AND_BF16(RINGLIGHT_PERCEPTRON)
#undef RINGLIGHT_PERCEPTRON

}  // namespace ringlight
