#include "arrays.hpp"
#include "bindings.hpp"
#include "dispatch.hpp"
#include "sh.hpp"

namespace nb = nanobind;

namespace ringlight {
namespace {

using Points = Tensor<const float, -1, 3>;
using Rest = Tensor<const float, -1, 15, 3>;
using Position = Tensor<const float, 3>;
using PointsOut = Tensor<float, -1, 3>;
using RestOut = Tensor<float, -1, 15, 3>;

Harmonics as_table(const Points& means, const Points& constant, const Rest& rest, const Position& position,
                   int degree) {
  require(constant.shape(0) == means.shape(0) && rest.shape(0) == means.shape(0),
          "sh: all columns must have the same number of rows");
  require(degree >= 0 && degree <= 3, "sh: the degree must be 0 to 3");
  const float* p = position.data();
  return {means.data(), constant.data(), rest.data(), means.shape(0), {p[0], p[1], p[2]}, degree};
}

void colors(const Points& means, const Points& constant, const Rest& rest, const Position& position, int degree,
            const PointsOut& out) {
  const Harmonics table = as_table(means, constant, rest, position, degree);
  require(out.shape(0) == table.count, "sh_colors: colors must have one row per Gaussian");
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(sh_colors)(table, out.data());
}

void gradient(const Points& means, const Points& constant, const Rest& rest, const Position& position, int degree,
              const Points& upstream, const PointsOut& by_means, const PointsOut& by_constant,
              const RestOut& by_rest) {
  const Harmonics table = as_table(means, constant, rest, position, degree);
  require(upstream.shape(0) == table.count && by_means.shape(0) == table.count &&
              by_constant.shape(0) == table.count && by_rest.shape(0) == table.count,
          "sh_gradient: all gradients must have one row per Gaussian");
  const HarmonicsGradient out{by_means.data(), by_constant.data(), by_rest.data()};
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(sh_gradient)(table, upstream.data(), out);
}

}  // namespace

void bind_sh(nb::module_& module) {
  module.def("sh_colors", &colors, nb::arg("means"), nb::arg("constant"),
             nb::arg("rest"), nb::arg("position"), nb::arg("degree"),
             nb::arg("colors"), "Fill colors [N 3], clamped at black, towards a camera at position [3].");
  module.def("sh_gradient", &gradient, nb::arg("means"), nb::arg("constant"),
             nb::arg("rest"), nb::arg("position"), nb::arg("degree"),
             nb::arg("upstream"), nb::arg("by_means"), nb::arg("by_constant"),
             nb::arg("by_rest"), "Overwrite by_* with the gradients of sh_colors, every row.");
}

}  // namespace ringlight
