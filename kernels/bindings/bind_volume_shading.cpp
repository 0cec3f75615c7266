#include <nanobind/stl/optional.h>

#include <optional>

#include "bindings/volume_inputs.hpp"
#include "simd/dispatch.hpp"

namespace ringlight {
namespace {

constexpr std::size_t WIDEST = convention::VOLUME_MOST_UNITS, WAVES = 1 + 2 * convention::VOLUME_FREQUENCIES;

// Of components a basis; then weight and bias of three layers.
template <class Float, class Tensors>
VolumeNetwork<Float> network_from(const Tensors& tensors, std::size_t components, VolumeShape& shape) {
  const std::size_t layers = components ? 1 : 0;
  require(tensors.size() == layers + 6 && tensors[0].ndim() == 2 && tensors[layers].ndim() == 2,
          "volume: a basis of what has components, and weight and bias of three layers");
  const std::size_t inputs = tensors[layers].shape(1), hidden = tensors[layers].shape(0), features = inputs / WAVES - 3;
  require(inputs > 3 * WAVES && inputs % WAVES == 0 && hidden > 0 && inputs <= WIDEST && hidden <= WIDEST,
          "volume: a width does not fit, or is above 8192");
  const std::size_t widths[4] = {inputs, hidden, hidden, 3};
  require(!components || (tensors[0].shape(0) == features && tensors[0].shape(1) == components),
          "volume: the basis must be [F C]");
  VolumeNetwork<Float> made{};
  if (components) made.basis = tensors[0].data();
  for (std::size_t layer = 0; layer < 3; layer++) {
    const auto &weight = tensors[layers + 2 * layer], &bias = tensors[layers + 2 * layer + 1];
    require(weight.ndim() == 2 && weight.shape(0) == widths[layer + 1] && weight.shape(1) == widths[layer] &&
                bias.size() == widths[layer + 1],
            "volume: a layer must be [outputs inputs], with a bias for each output");
    made.weights[layer] = weight.data(), made.biases[layer] = bias.data();
  }
  shape = {static_cast<int>(features), static_cast<int>(hidden)};
  return made;
}

VolumeRows rows_from(const Numbers& rays, const Points& directions) {
  require_numbers(rays, directions.shape(0));
  return {rays.data(), rays.size()};
}

struct Looked {
  VolumeSeen seen;
  std::size_t components;  // of a row; none of features
};

// Factors, places, and the samples that are shown.
using Sampled = std::tuple<Inputs, Points, Numbers>;

Looked looked_from(const Sampled& sampled, std::size_t rows) {
  const auto& [factors, places, samples] = sampled;
  require(samples.size() == rows, "volume: a sample for each row");
  require_numbers(samples, places.shape(0));
  const auto grid = factors_from<const float>(factors);
  return {{nullptr, grid, places.data(), samples.data()}, static_cast<std::size_t>(grid.width())};
}

Looked looked_from(const Input& features, std::size_t rows) {
  require(features.ndim() == 2 && features.shape(0) == rows, "volume: features must be [S F]");
  return {{features.data(), {}, nullptr, nullptr}, 0};
}

void require_features(const Input& features, const VolumeShape& shape) {
  require(features.shape(1) == static_cast<std::size_t>(shape.features), "volume: features must be the network's");
}
void require_features(const Sampled&, const VolumeShape&) {}

// Of both hidden layers, or null.
template <class Units>
auto hidden_from(const std::optional<Units>& hidden, const VolumeRows& rows, const VolumeShape& shape) {
  const std::size_t numbers = 2 * rows.count * static_cast<std::size_t>(shape.hidden);
  require(!hidden || hidden->size() == numbers, "volume: hidden units must be of two layers and all rows");
  return hidden ? hidden->data() : nullptr;
}

template <class Source>
void shade(const Source& source, const Inputs& network, Numbers rays, Points directions, bool halves,
           Tensor<float, -1, 3> colors, const std::optional<Array>& hidden) {
  const VolumeRows rows = rows_from(rays, directions);
  const Looked looked = looked_from(source, rows.count);
  VolumeShape shape;
  const auto layers = network_from<const float>(network, looked.components, shape);
  require_features(source, shape);
  require(colors.shape(0) == rows.count, "volume: a colour for each row");
  float* to_hidden = hidden_from(hidden, rows, shape);
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN_WITH_BF16(volume_shade)(shape, looked.seen, layers, rows, directions.data(), halves,
                                           colors.data(), to_hidden);
}

template <class Source>
void shade_gradient(const Source& source, const Inputs& network, Numbers rays, Points directions, bool halves,
                    const std::optional<Input>& hidden, Points grad_colors, Array grad_seen, const Arrays& gradients) {
  const VolumeRows rows = rows_from(rays, directions);
  const Looked looked = looked_from(source, rows.count);
  VolumeShape shape, of_gradients;
  const auto layers = network_from<const float>(network, looked.components, shape);
  const auto to = network_from<float>(gradients, looked.components, of_gradients);
  require_features(source, shape);
  require(shape.features == of_gradients.features && shape.hidden == of_gradients.hidden,
          "volume: gradients must have the network's sizes");
  const std::size_t width = looked.components ? looked.components : static_cast<std::size_t>(shape.features);
  require(grad_colors.shape(0) == rows.count && grad_seen.size() == rows.count * width,
          "volume: gradients must be of all rows");
  const float* of_hidden = hidden_from(hidden, rows, shape);
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN_WITH_BF16(volume_shade_gradient)(shape, looked.seen, layers, rows, directions.data(), halves,
                                                    of_hidden, grad_colors.data(), grad_seen.data(), to);
}

}  // namespace

void bind_volume_shading(nb::module_& module) {
  module.def("volume_shade", &shade<Sampled>, "sampled"_a, "network"_a, "rays"_a, "directions"_a, "halves"_a,
             "colors"_a, "hidden"_a.none(),
             "Colours of samples: factors, places, and the numbers of those that are shown. Keeps hidden units.");
  module.def("volume_shade", &shade<Input>, "features"_a, "network"_a, "rays"_a, "directions"_a, "halves"_a,
             "colors"_a, "hidden"_a.none(), "Colours of features. Keeps hidden units.");
  module.def("volume_shade_gradient", &shade_gradient<Sampled>, "sampled"_a, "network"_a, "rays"_a, "directions"_a,
             "halves"_a, "hidden"_a.none(), "grad_colors"_a, "grad_components"_a, "gradients"_a,
             "Gradients of basis and layers, and of each row's components; hidden units are made again or were kept.");
  module.def("volume_shade_gradient", &shade_gradient<Input>, "features"_a, "network"_a, "rays"_a, "directions"_a,
             "halves"_a, "hidden"_a.none(), "grad_colors"_a, "grad_features"_a, "gradients"_a,
             "Gradients of layers, and of each row's features; hidden units are made again or were kept.");
}

}  // namespace ringlight
