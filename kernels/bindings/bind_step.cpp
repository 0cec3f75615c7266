#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <optional>
#include <tuple>
#include <vector>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "simd/dispatch.hpp"
#include "step/adam.hpp"
#include "step/screen_gradient.hpp"

namespace ringlight {
namespace {

using Arrays = std::vector<Array>;
using Inputs = std::vector<Input>;
// Rate, both betas, epsilon, and the number of the update.
using Steps = std::vector<std::tuple<float, float, float, float, long>>;

std::size_t adam_step(const Arrays& values, const Inputs& gradients, const Arrays& means, const Arrays& squares,
                      const Steps& steps, const std::optional<Tensor<const float, -1, 2>>& radii) {
  const std::size_t count = values.size();
  require(gradients.size() == count && means.size() == count && squares.size() == count && steps.size() == count,
        "adam: every parameter needs a gradient, two moments and its step");
  std::vector<AdamColumn> columns;
  columns.reserve(count);
  for (std::size_t i = 0; i < count; i++) {
    const std::size_t size = values[i].size(), rows = radii ? radii->shape(0) : size;
    require(gradients[i].size() == size && means[i].size() == size && squares[i].size() == size,
          "adam: value, gradient and moments must have the same size");
    const auto [rate, beta1, beta2, epsilon, step] = steps[i];
    require(step >= 1, "adam: steps count from 1");
    if (size == 0) continue;
    require(rows > 0 && size % rows == 0, "adam: every parameter needs as many rows as radii");
    columns.push_back({values[i].data(), gradients[i].data(), means[i].data(), squares[i].data(), rows, size / rows,
                       {rate, beta1, beta2, epsilon, step}});
  }
  const nb::gil_scoped_release unlocked;
  const auto run = RINGLIGHT_CHOSEN(adam);
  return run(columns.data(), columns.size(), radii ? radii->data() : nullptr);
}

void add_screen_gradient(Input gradient, Input radii, float scale_x, float scale_y, Array total, Array views) {
  const std::size_t count = total.size();
  require(gradient.size() == 2 * count && radii.size() == 2 * count && views.size() == count,
        "accumulate_screen_gradient: gradient and radii must be [N 2], total and views [N]");
  const nb::gil_scoped_release unlocked;
  const auto run = RINGLIGHT_CHOSEN(accumulate_screen_gradient);
  run(gradient.data(), radii.data(), {scale_x, scale_y}, total.data(), views.data(), count);
}

}  // namespace

void bind_step(nb::module_& module) {
  module.def("adam", &adam_step, "values"_a, "gradients"_a, "means"_a, "squares"_a, "steps"_a,
             "radii"_a.none() = nb::none(),
             "One Adam update of many parameters in place; steps are (rate, beta1, beta2, epsilon, number of the "
             "update). With radii [N 2] only the rows that were drawn are updated. Elements of which any would not be "
             "finite stay as they are; returns how many.");
  module.def("accumulate_screen_gradient", &add_screen_gradient, "gradient"_a, "radii"_a, "scale_x"_a,
             "scale_y"_a, "total"_a, "views"_a,
             "Add the length of each drawn row's screen-space gradient to total, and 1 to views, in place.");
}

}  // namespace ringlight
