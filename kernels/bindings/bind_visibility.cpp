#include <nanobind/ndarray.h>
#include <nanobind/stl/vector.h>

#include <stdexcept>
#include <vector>

#include "bindings.hpp"
#include "dispatch.hpp"
#include "visibility.hpp"

namespace nb = nanobind;

namespace ringlight {
namespace {

using Array = nb::ndarray<float, nb::c_contig, nb::device::cpu>;
using Input = nb::ndarray<const float, nb::c_contig, nb::device::cpu>;
using Rows = nb::ndarray<std::int32_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

void check(bool right, const char* message) {
  if (!right) throw std::invalid_argument(message);
}

std::size_t frustum(Input means, Input log_scales, const std::vector<float>& view, Rows rows) {
  const std::size_t count = rows.size();
  check(means.size() == 3 * count && log_scales.size() == 3 * count, "rows_in_frustum: means and scales must be [N 3]");
  check(view.size() == 21, "rows_in_frustum: a view is a matrix, focal, center, size and three margins");
  FrustumView frustum;
  for (int i = 0; i < 12; i++) frustum.world_to_camera[i] = view[i];
  for (int i = 0; i < 2; i++) {
    frustum.focal[i] = view[12 + i];
    frustum.center[i] = view[14 + i];
    frustum.size[i] = view[16 + i];
  }
  frustum.reach_sigmas = view[18], frustum.reach_pixels = view[19], frustum.slope_margin = view[20];
  const nb::gil_scoped_release unlocked;
  return (current_isa() == Isa::v4 ? v4::rows_in_frustum : v3::rows_in_frustum)(means.data(), log_scales.data(), count,
                                                                                frustum, rows.data());
}

void mask(Input logits, float threshold, Array factor) {
  check(factor.size() == logits.size(), "straight_through: one factor per logit");
  const nb::gil_scoped_release unlocked;
  (current_isa() == Isa::v4 ? v4::straight_through : v3::straight_through)(logits.data(), logits.size(), threshold,
                                                                           factor.data());
}

void mask_gradient(Input logits, Input upstream, Array gradient) {
  check(upstream.size() == logits.size() && gradient.size() == logits.size(),
        "straight_through_gradient: one gradient per logit");
  const nb::gil_scoped_release unlocked;
  (current_isa() == Isa::v4 ? v4::straight_through_gradient
                            : v3::straight_through_gradient)(logits.data(), upstream.data(), logits.size(),
                                                             gradient.data());
}

}  // namespace

void bind_visibility(nb::module_& module) {
  module.def("rows_in_frustum", &frustum, nb::arg("means").noconvert(), nb::arg("log_scales").noconvert(),
             nb::arg("view"), nb::arg("rows").noconvert(), "Lists the rows that may be seen; returns how many.");
  module.def("straight_through", &mask, nb::arg("logits").noconvert(), nb::arg("threshold"),
             nb::arg("factor").noconvert(), "One where sigmoid(logit) > threshold, else zero.");
  module.def("straight_through_gradient", &mask_gradient, nb::arg("logits").noconvert(),
             nb::arg("upstream").noconvert(), nb::arg("gradient").noconvert(), "The sigmoid's gradient.");
}

}  // namespace ringlight
