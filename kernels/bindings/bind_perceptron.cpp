#include <nanobind/stl/optional.h>

#include <optional>

#include "bindings/bindings.hpp"
#include "bindings/perceptron_inputs.hpp"
#include "simd/dispatch.hpp"

namespace ringlight {
namespace {

using Stack = Tensor<const float, -1, -1, -1>;

PerceptronShape shape_from(const Stack& rows, const std::vector<Input>& parameters, std::size_t results) {
  constexpr std::size_t MOST_HEADS = 1 << 10, MOST_NODES = 1 << 20, WIDEST = 1 << 14;  // products fit an int
  const std::size_t heads = rows.shape(0), nodes = rows.shape(1), inputs = rows.shape(2);
  require(heads && nodes && parameters.size() == 6, "perceptron: no rows, or not three layers");
  require(heads <= MOST_HEADS && nodes <= MOST_NODES, "perceptron: too many heads or nodes");
  const std::size_t hidden = parameters[1].size() / heads, outputs = results / (heads * nodes);
  require(results == heads * nodes * outputs, "perceptron: results and their gradient must be [H K outputs]");
  require(inputs && hidden && outputs && inputs <= WIDEST && hidden <= WIDEST && outputs <= WIDEST,
          "perceptron: a width is 0 or above 2^14");
  return {static_cast<int>(heads), static_cast<int>(nodes), static_cast<int>(inputs), static_cast<int>(hidden),
          static_cast<int>(outputs)};
}

void forward(const std::vector<Input>& parameters, Stack rows, Array results) {
  const PerceptronShape shape = shape_from(rows, parameters, results.size());
  const auto layers = layers_from<const float>(shape, parameters);
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN_WITH_BF16(perceptron_forward)(shape, layers, rows.data(), results.data());
}

void backward(const std::vector<Input>& parameters, Stack rows, Input upstream, const std::vector<Array>& gradients,
              const std::optional<Array>& of_rows) {
  const PerceptronShape shape = shape_from(rows, parameters, upstream.size());
  const auto layers = layers_from<const float>(shape, parameters);
  const auto sums = layers_from<float>(shape, gradients);
  require(!of_rows || of_rows->size() == rows.size(), "perceptron: the gradient of rows must be [H K inputs]");
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN_WITH_BF16(perceptron_backward)
  (shape, layers, rows.data(), upstream.data(), sums, of_rows ? of_rows->data() : nullptr);
}

}  // namespace

void bind_perceptron(nb::module_& module) {
  module.def("perceptron_forward", &forward, "parameters"_a, "rows"_a, "results"_a,
             "H perceptrons of three layers, each at its own rows [H K inputs].");
  module.def("perceptron_backward", &backward, "parameters"_a, "rows"_a, "upstream"_a, "gradients"_a,
             "of_rows"_a = nb::none(), "Gradients of all weights and biases, and of the rows if they are wanted.");
}

}  // namespace ringlight
