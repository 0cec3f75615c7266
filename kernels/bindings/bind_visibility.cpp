#include <nanobind/stl/vector.h>

#include <limits>
#include <vector>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "raster/visibility.hpp"
#include "simd/dispatch.hpp"

namespace nb = nanobind;

namespace ringlight {
namespace {

using Rows = Tensor<std::int32_t, -1>;

std::size_t drawable(Input means, Input log_scales, Input opacity_logits, const std::vector<float>& view, Rows rows) {
  const std::size_t count = rows.size();
  require(count <= std::numeric_limits<std::int32_t>::max(), "drawable_rows: too many rows");
  require(means.size() == 3 * count && log_scales.size() == 3 * count && opacity_logits.size() == count,
        "drawable_rows: means and log_scales must be [N 3], opacity_logits [N]");
  require(view.size() == 22, "drawable_rows: a view is a matrix, focal, center, size and four margins");
  DrawableView at;
  for (int i = 0; i < 12; i++) at.world_to_camera[i] = view[i];
  for (int i = 0; i < 2; i++) {
    at.focal[i] = view[12 + i];
    at.center[i] = view[14 + i];
    at.size[i] = view[16 + i];
  }
  at.reach_sigmas = view[18], at.reach_pixels = view[19], at.slope_margin = view[20], at.faintest_logit = view[21];
  const SplatColumns table{means.data(), log_scales.data(), opacity_logits.data(), count};
  const nb::gil_scoped_release unlocked;
  return RINGLIGHT_CHOSEN(drawable_rows)(table, at, rows.data());
}

void mask(Input logits, float threshold, Array factor) {
  require(factor.size() == logits.size(), "straight_through: one factor per logit");
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(straight_through)(logits.data(), logits.size(), threshold, factor.data());
}

void mask_gradient(Input logits, Input upstream, Array gradient) {
  require(upstream.size() == logits.size() && gradient.size() == logits.size(),
        "straight_through_gradient: one gradient per logit");
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(straight_through_gradient)(logits.data(), upstream.data(), logits.size(), gradient.data());
}

}  // namespace

void bind_visibility(nb::module_& module) {
  module.def("drawable_rows", &drawable, nb::arg("means"), nb::arg("log_scales"),
             nb::arg("opacity_logits"), nb::arg("view"), nb::arg("rows"),
             "Lists the rows that may be drawn; returns how many.");
  module.def("straight_through", &mask, nb::arg("logits"), nb::arg("threshold"),
             nb::arg("factor"), "One where sigmoid(logit) > threshold, else zero.");
  module.def("straight_through_gradient", &mask_gradient, nb::arg("logits"),
             nb::arg("upstream"), nb::arg("gradient"), "The sigmoid's gradient.");
}

}  // namespace ringlight
