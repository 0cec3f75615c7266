#include <limits>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "raster/visibility.hpp"
#include "simd/dispatch.hpp"

namespace ringlight {
namespace {

using Rows = Tensor<std::int32_t, -1>;

std::size_t drawable(Input means, Input log_scales, Input opacity_logits, const Camera& camera, Rows rows,
                     float reach_sigmas, float reach_pixels, float slope_margin, float faintest_logit) {
  const std::size_t count = rows.size();
  require(count <= std::numeric_limits<std::int32_t>::max(), "drawable_rows: too many rows");
  require(means.size() == 3 * count && log_scales.size() == 3 * count && opacity_logits.size() == count,
        "drawable_rows: means and log_scales must be [N 3], opacity_logits [N]");
  const DrawableMargins margins{reach_sigmas, reach_pixels, slope_margin, faintest_logit};
  const SplatColumns table{means.data(), log_scales.data(), opacity_logits.data(), count};
  const nb::gil_scoped_release unlocked;
  return RINGLIGHT_CHOSEN(drawable_rows)(table, camera, margins, rows.data());
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
  module.def("drawable_rows", &drawable, "means"_a, "log_scales"_a, "opacity_logits"_a, "camera"_a, "rows"_a,
             nb::kw_only(), "reach_sigmas"_a, "reach_pixels"_a, "slope_margin"_a, "faintest_logit"_a,
             "Lists the rows that may be drawn; returns how many.");
  module.def("straight_through", &mask, "logits"_a, "threshold"_a, "factor"_a,
             "One where sigmoid(logit) > threshold, else zero.");
  module.def("straight_through_gradient", &mask_gradient, "logits"_a, "upstream"_a, "gradient"_a,
             "The sigmoid's gradient.");
}

}  // namespace ringlight
