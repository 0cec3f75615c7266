#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <array>
#include <optional>
#include <tuple>
#include <vector>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "simd/dispatch.hpp"
#include "volume/volume.hpp"

namespace ringlight {
namespace {

using Points = Tensor<const float, -1, 3>;
using Bits = Tensor<const std::int8_t, -1, -1, -1>;
using Counts = Tensor<std::int32_t, -1>;
using Numbers = Tensor<const std::int32_t, -1>;
using Offsets = Tensor<const std::int64_t, -1>;
using Inputs = std::vector<Input>;
using Arrays = std::vector<Array>;
// Origins, directions, jitter.
using Rays = std::tuple<Points, Points, Tensor<const float, -1>>;
// The box's corners and the cells', x y z each; bits; step; most samples.
using Space = std::tuple<std::array<float, 12>, Bits, float, int>;

constexpr std::size_t LANES = 16, WIDEST = 4096, MOST = std::size_t{1} << 31;

VolumeRays rays_from(const Rays& rays) {
  const auto& [origins, directions, jitter] = rays;
  require(origins.shape(0) == directions.shape(0) && origins.shape(0) == jitter.shape(0),
          "volume: rays must have as many origins, directions and jitters");
  return {origins.data(), directions.data(), jitter.data(), origins.shape(0)};
}

VolumeSpace space_from(const Space& space) {
  const auto& [corners, bits, step, most] = space;
  VolumeSpace made{};
  for (int axis = 0; axis < 3; axis++) {
    made.low[axis] = corners[axis], made.high[axis] = corners[3 + axis];
    made.cells_low[axis] = corners[6 + axis], made.cells_high[axis] = corners[9 + axis];
    require(made.low[axis] < made.high[axis] && made.cells_low[axis] < made.cells_high[axis],
            "volume: a box has no inside");
    require(bits.shape(axis) > 0 && bits.shape(axis) <= WIDEST, "volume: no cells, or too many along an axis");
    made.cells[axis] = static_cast<int>(bits.shape(axis)) * (axis == 2 ? 8 : 1);
  }
  require(step > 0 && most >= 0 && most <= (1 << 20), "volume: a step must be positive, and a ray at most 2^20 long");
  made.bits = reinterpret_cast<const std::uint8_t*>(bits.data()), made.step = step, made.most = most;
  return made;
}

// Three planes, then three lines.
template <class Float, class Tensors>
VolumeFactors<Float> factors_from(const Tensors& tensors) {
  require(tensors.size() == 6, "volume: three planes and three lines");
  VolumeFactors<Float> made{};
  constexpr int axes[3][3] = {{0, 1, 2}, {0, 2, 1}, {1, 2, 0}};
  require(tensors[3].ndim() == 2, "volume: lines must be [S C]");
  const std::size_t components = tensors[3].shape(1);
  require(components > 0 && components <= WIDEST && components % LANES == 0,
          "volume: components must be a multiple of 16");
  made.components = static_cast<int>(components);
  for (int pair = 0; pair < 3; pair++) {
    const auto& line = tensors[3 + pair];
    require(line.ndim() == 2 && line.shape(1) == components && line.shape(0) >= 2 && line.shape(0) <= WIDEST,
            "volume: lines must be [S C] of 2 to 4096 nodes");
    made.sides[axes[pair][2]] = static_cast<int>(line.shape(0));
    made.lines[pair] = line.data();
  }
  for (int pair = 0; pair < 3; pair++) {
    const auto& plane = tensors[pair];
    require(plane.ndim() == 3 && plane.shape(2) == components &&
                plane.shape(1) == static_cast<std::size_t>(made.sides[axes[pair][0]]) &&
                plane.shape(0) == static_cast<std::size_t>(made.sides[axes[pair][1]]),
            "volume: planes must be [S_b S_a C] of the lines' nodes");
    made.planes[pair] = plane.data();
  }
  return made;
}

void require_offsets(const Offsets& offsets, std::size_t rays, std::size_t samples) {
  require(offsets.size() == rays + 1 && offsets.data()[0] == 0 && samples < MOST, "volume: offsets must be [R + 1]");
  for (std::size_t ray = 0; ray < rays; ray++)
    require(offsets.data()[ray] <= offsets.data()[ray + 1], "volume: offsets must rise");
  require(static_cast<std::size_t>(offsets.data()[rays]) == samples, "volume: offsets must end with all samples");
}

// Places, along, weights, left, slopes.
VolumeSamples samples_from(const Arrays& tensors) {
  require(tensors.size() == 5, "volume: five arrays of samples");
  const std::size_t count = tensors[1].size();
  require(tensors[0].size() == 3 * count, "volume: places must be [M 3]");
  for (std::size_t i = 2; i < 5; i++) require(tensors[i].size() == count, "volume: samples must be [M]");
  return {tensors[0].data(), tensors[1].data(), tensors[2].data(), tensors[3].data(), tensors[4].data()};
}

void count(const Rays& rays, const Space& space, Counts counts) {
  const VolumeRays from = rays_from(rays);
  const VolumeSpace within = space_from(space);
  require(counts.size() == from.count, "volume: a count for each ray");
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(volume_count)(from, within, counts.data());
}

void march(const Rays& rays, const Space& space, const Inputs& factors, std::tuple<float, float, float, float> optics,
           const Offsets& offsets, const Arrays& samples, Counts shown, Array alpha, Array depth) {
  const VolumeRays from = rays_from(rays);
  const VolumeSpace within = space_from(space);
  const auto grid = factors_from<const float>(factors);
  const VolumeSamples to = samples_from(samples);
  require_offsets(offsets, from.count, samples[1].size());
  require(shown.size() == from.count && alpha.size() == from.count && depth.size() == from.count,
          "volume: shown, alpha and depth must be [R]");
  const auto [shift, optical, least, end] = optics;
  const auto run = RINGLIGHT_CHOSEN(volume_march);
  const nb::gil_scoped_release unlocked;
  run(from, within, grid, {shift, optical, least, end}, offsets.data(), to, shown.data(), alpha.data(), depth.data());
}

void density(const Inputs& factors, Points places, Array found) {
  const auto grid = factors_from<const float>(factors);
  require(found.size() == places.shape(0), "volume: a density for each place");
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(volume_density)(grid, places.data(), places.shape(0), found.data());
}

void require_shown(const Offsets& offsets, const Offsets& shown, std::size_t rays, std::size_t colors,
                   std::size_t samples) {
  require_offsets(offsets, rays, samples);
  require_offsets(shown, rays, colors);
}

void blend(const Offsets& offsets, const Offsets& shown, Input weights, float least, Points colors, Input alpha,
           Tensor<const float, 3> background, Tensor<float, -1, 3> blended) {
  const std::size_t rays = blended.shape(0);
  require_shown(offsets, shown, rays, colors.shape(0), weights.size());
  require(alpha.size() == rays, "volume: an alpha for each ray");
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(volume_blend)(rays, offsets.data(), shown.data(), weights.data(), least, colors.data(),
                                 alpha.data(), background.data(), blended.data());
}

void unblend(const Offsets& offsets, const Offsets& shown, const Arrays& samples, float least, Points colors,
             Tensor<const float, 3> background, Points grad_color, const std::optional<Input>& grad_alpha,
             const std::optional<Input>& grad_depth, Tensor<float, -1, 3> grad_colors, Array grad_density) {
  const std::size_t rays = grad_color.shape(0);
  const VolumeSamples from = samples_from(samples);
  require_shown(offsets, shown, rays, colors.shape(0), samples[1].size());
  require((!grad_alpha || grad_alpha->size() == rays) && (!grad_depth || grad_depth->size() == rays),
          "volume: gradients of alpha and depth must be [R]");
  require(grad_colors.shape(0) == colors.shape(0) && grad_density.size() == samples[1].size(),
          "volume: gradients must be of all colours and samples");
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(volume_unblend)(rays, offsets.data(), shown.data(), from, least, colors.data(), background.data(),
                                   grad_color.data(), grad_alpha ? grad_alpha->data() : nullptr,
                                   grad_depth ? grad_depth->data() : nullptr, grad_colors.data(),
                                   grad_density.data());
}

void require_numbers(const Numbers& numbers, std::size_t below) {
  for (std::size_t i = 0; i < numbers.size(); i++)
    require(numbers.data()[i] >= 0 && static_cast<std::size_t>(numbers.data()[i]) < below,
            "volume: a number of a sample or ray is out of range");
}

void scatter(const Inputs& factors, Points places, const std::optional<Numbers>& samples, Input gradient,
             const Arrays& gradients) {
  const auto grid = factors_from<const float>(factors);
  const auto to = factors_from<float>(gradients);
  for (int axis = 0; axis < 3; axis++)
    require(grid.sides[axis] == to.sides[axis], "volume: gradients must have the factors' sizes");
  require(grid.components == to.components, "volume: gradients must have the factors' sizes");
  const std::size_t rows = samples ? samples->size() : places.shape(0), width = 3 * grid.components;
  const bool by_component = gradient.size() == rows * width;
  require(by_component || gradient.size() == rows, "volume: a gradient for each sample, or for each component of it");
  if (samples) require_numbers(*samples, places.shape(0));
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(volume_scatter)(grid, places.data(), samples ? samples->data() : nullptr, rows, gradient.data(),
                                   by_component, to);
}

// Basis, then weight and bias of three layers.
template <class Float, class Tensors>
VolumeNetwork<Float> network_from(const Tensors& tensors, std::size_t components, VolumeShape& shape) {
  require(tensors.size() == 7 && tensors[0].ndim() == 2 && tensors[1].ndim() == 2,
          "volume: a basis, and weight and bias of three layers");
  const std::size_t features = tensors[0].shape(0), inputs = 5 * (features + 3), hidden = tensors[1].shape(0);
  require(features > 0 && hidden > 0 && features <= WIDEST && hidden <= WIDEST, "volume: a width is 0 or above 4096");
  const std::size_t widths[4] = {inputs, hidden, hidden, 3};
  require(tensors[0].size() == features * components, "volume: the basis must be [F C]");
  VolumeNetwork<Float> made{};
  made.basis = tensors[0].data();
  for (int layer = 0; layer < 3; layer++) {
    require(tensors[1 + 2 * layer].size() == widths[layer] * widths[layer + 1] &&
                tensors[2 + 2 * layer].size() == widths[layer + 1],
            "volume: a layer has the wrong size");
    made.weights[layer] = tensors[1 + 2 * layer].data();
    made.biases[layer] = tensors[2 + 2 * layer].data();
  }
  shape = {static_cast<int>(features), static_cast<int>(hidden)};
  return made;
}

VolumeRows rows_from(const Numbers& samples, const Numbers& rays, const Points& places, const Points& directions) {
  require(samples.size() == rays.size(), "volume: a ray for each row");
  require_numbers(samples, places.shape(0));
  require_numbers(rays, directions.shape(0));
  return {samples.data(), rays.data(), samples.size()};
}

void shade(const Inputs& factors, const Inputs& network, Numbers samples, Numbers rays, Points places,
           Points directions, bool halves, Tensor<float, -1, 3> colors) {
  const auto grid = factors_from<const float>(factors);
  VolumeShape shape;
  const auto layers = network_from<const float>(network, 3 * static_cast<std::size_t>(grid.components), shape);
  const VolumeRows rows = rows_from(samples, rays, places, directions);
  require(colors.shape(0) == rows.count, "volume: a colour for each row");
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN_WITH_BF16(volume_shade)(shape, grid, layers, rows, places.data(), directions.data(), halves,
                                           colors.data());
}

void shade_gradient(const Inputs& factors, const Inputs& network, Numbers samples, Numbers rays, Points places,
                    Points directions, bool halves, Points grad_colors, Array grad_components,
                    const Arrays& gradients) {
  const auto grid = factors_from<const float>(factors);
  const std::size_t components = 3 * static_cast<std::size_t>(grid.components);
  VolumeShape shape, of_gradients;
  const auto layers = network_from<const float>(network, components, shape);
  const auto to = network_from<float>(gradients, components, of_gradients);
  require(shape.features == of_gradients.features && shape.hidden == of_gradients.hidden,
          "volume: gradients must have the network's sizes");
  const VolumeRows rows = rows_from(samples, rays, places, directions);
  require(grad_colors.shape(0) == rows.count && grad_components.size() == rows.count * components,
          "volume: gradients must be of all rows");
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN_WITH_BF16(volume_shade_gradient)(shape, grid, layers, rows, places.data(), directions.data(),
                                                    halves, grad_colors.data(), grad_components.data(), to);
}

}  // namespace

void bind_volume(nb::module_& module) {
  module.def("volume_count", &count, "rays"_a, "space"_a, "counts"_a, "Samples of each ray that are not empty.");
  module.def("volume_march", &march, "rays"_a, "space"_a, "factors"_a, "optics"_a, "offsets"_a, "samples"_a, "shown"_a,
             "alpha"_a, "depth"_a,
             "Fills samples (places, along, weights, left, slopes) and, by ray, how many are shown, alpha and depth. "
             "Optics are the shift of density, the thickness of a step, the least weight that is shown, and the light "
             "at which a ray ends.");
  module.def("volume_density", &density, "factors"_a, "places"_a, "density"_a, "Sums of all components.");
  module.def("volume_blend", &blend, "offsets"_a, "shown"_a, "weights"_a, "least"_a, "colors"_a, "alpha"_a,
             "background"_a, "blended"_a, "Colours of rays over the background.");
  module.def("volume_unblend", &unblend, "offsets"_a, "shown"_a, "samples"_a, "least"_a, "colors"_a, "background"_a,
             "grad_color"_a, "grad_alpha"_a.none(), "grad_depth"_a.none(), "grad_colors"_a, "grad_density"_a,
             "Gradients of the colours that are shown, and of what softplus is taken of.");
  module.def("volume_scatter", &scatter, "factors"_a, "places"_a, "samples"_a.none(), "gradient"_a, "gradients"_a,
             "Adds the gradients of planes and lines: of samples by number, or of all.");
  module.def("volume_shade", &shade, "factors"_a, "network"_a, "samples"_a, "rays"_a, "places"_a, "directions"_a,
             "halves"_a, "colors"_a, "Colours of the samples that are shown.");
  module.def("volume_shade_gradient", &shade_gradient, "factors"_a, "network"_a, "samples"_a, "rays"_a, "places"_a,
             "directions"_a, "halves"_a, "grad_colors"_a, "grad_components"_a, "gradients"_a,
             "Gradients of basis and layers, and of each row's components.");
}

}  // namespace ringlight
