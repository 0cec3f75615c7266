#include <nanobind/ndarray.h>

#include <stdexcept>

#include "adam.hpp"
#include "bindings.hpp"
#include "dispatch.hpp"

namespace nb = nanobind;

namespace ringlight {
namespace {

using Array = nb::ndarray<float, nb::c_contig, nb::device::cpu>;
using Input = nb::ndarray<const float, nb::c_contig, nb::device::cpu>;

void adam_step(Array value, Input gradient, Array mean, Array square, float rate, float beta1, float beta2,
               float epsilon, long step) {
  const std::size_t count = value.size();
  if (gradient.size() != count || mean.size() != count || square.size() != count)
    throw std::invalid_argument("adam: value, gradient and moments must have the same size");
  const nb::gil_scoped_release unlocked;
  const auto run = current_isa() == Isa::v4 ? v4::adam : v3::adam;
  run(value.data(), gradient.data(), mean.data(), square.data(), count, {rate, beta1, beta2, epsilon, step});
}

}  // namespace

void bind_fit(nb::module_& module) {
  module.def("adam", &adam_step, nb::arg("value").noconvert(), nb::arg("gradient").noconvert(),
             nb::arg("mean").noconvert(), nb::arg("square").noconvert(), nb::arg("rate"), nb::arg("beta1"),
             nb::arg("beta2"), nb::arg("epsilon"), nb::arg("step"), "One Adam update in place; all arrays float32.");
}

}  // namespace ringlight
