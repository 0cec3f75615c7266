#include "adam.hpp"
#include "arrays.hpp"
#include "bindings.hpp"
#include "dispatch.hpp"
#include "pull.hpp"

namespace nb = nanobind;

namespace ringlight {
namespace {

void adam_step(Array value, Input gradient, Array mean, Array square, float rate, float beta1, float beta2,
               float epsilon, long step) {
  const std::size_t count = value.size();
  check(gradient.size() == count && mean.size() == count && square.size() == count,
        "adam: value, gradient and moments must have the same size");
  check(step >= 1, "adam: steps count from 1");
  const nb::gil_scoped_release unlocked;
  const auto run = current_isa() == Isa::v4 ? v4::adam : v3::adam;
  run(value.data(), gradient.data(), mean.data(), square.data(), count, {rate, beta1, beta2, epsilon, step});
}

void add_pull(Input gradient, Input radii, float scale_x, float scale_y, Array pull, Array views) {
  const std::size_t count = pull.size();
  check(gradient.size() == 2 * count && radii.size() == 2 * count && views.size() == count,
        "accumulate_pull: gradient and radii must be [N 2], pull and views [N]");
  const nb::gil_scoped_release unlocked;
  const auto run = current_isa() == Isa::v4 ? v4::accumulate_pull : v3::accumulate_pull;
  run(gradient.data(), radii.data(), {scale_x, scale_y}, pull.data(), views.data(), count);
}

}  // namespace

void bind_fit(nb::module_& module) {
  module.def("adam", &adam_step, nb::arg("value").noconvert(), nb::arg("gradient").noconvert(),
             nb::arg("mean").noconvert(), nb::arg("square").noconvert(), nb::arg("rate"), nb::arg("beta1"),
             nb::arg("beta2"), nb::arg("epsilon"), nb::arg("step"), "One Adam update in place; all arrays float32.");
  module.def("accumulate_pull", &add_pull, nb::arg("gradient").noconvert(), nb::arg("radii").noconvert(),
             nb::arg("scale_x"), nb::arg("scale_y"), nb::arg("pull").noconvert(), nb::arg("views").noconvert(),
             "Add each drawn row's screen-space pull and visit to the running sums, in place.");
}

}  // namespace ringlight
