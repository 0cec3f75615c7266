// Parameters of a perceptron as Python hands them over.
#pragma once
#include <nanobind/stl/vector.h>

#include <vector>

#include "bindings/arrays.hpp"
#include "dense/perceptron.hpp"

namespace ringlight {

// Weight, bias, weight, bias, ...: [H inputs outputs] and [H 1 outputs].
template <class Float, class Arrays>
PerceptronLayers<Float> layers_from(const PerceptronShape& shape, const Arrays& arrays) {
  require(arrays.size() == 6, "perceptron: three layers have six parameters");
  const std::size_t widths[] = {static_cast<std::size_t>(shape.inputs), static_cast<std::size_t>(shape.hidden),
                                static_cast<std::size_t>(shape.hidden), static_cast<std::size_t>(shape.outputs)};
  PerceptronLayers<Float> layers;
  for (int layer = 0; layer < 3; layer++) {
    const auto &weight = arrays[2 * layer], &bias = arrays[2 * layer + 1];
    require(weight.size() == shape.heads * widths[layer] * widths[layer + 1] &&
                bias.size() == shape.heads * widths[layer + 1],
            "perceptron: a parameter has the wrong size");
    layers.weight[layer] = weight.data();
    layers.bias[layer] = bias.data();
  }
  return layers;
}

}  // namespace ringlight
