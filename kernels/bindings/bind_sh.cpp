#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>

#include <optional>
#include <tuple>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "convention.hpp"
#include "raster/camera.hpp"
#include "simd/dispatch.hpp"
#include "step/sh.hpp"
#include "step/sh_opacity.hpp"

namespace ringlight {
namespace {

using Points = Tensor<const float, -1, 3>;
using Rest = Tensor<const float, -1, -1, 3>;
using PointsOut = Tensor<float, -1, 3>;
using RestOut = Tensor<float, -1, -1, 3>;

std::size_t slope_count(std::size_t rows) { return (rows + 15) / 16 * 16 * SH_SLOPES; }

// `stored`: harmonics a row of the coefficients holds.
Harmonics as_table(const Points& means, std::size_t stored, const Camera& camera, int degree) {
  require(degree >= 0 && degree <= 3, "sh: the degree must be 0 to 3");
  const auto count = [](int of) { return static_cast<std::size_t>((of + 1) * (of + 1) - 1); };
  require(stored == count(0) || stored == count(1) || stored == count(2) || stored == count(3),
          "sh: a row must hold 0, 3, 8 or 15 harmonics");
  require(stored >= count(degree), "sh: a row must hold all harmonics up to the degree");
  const float* const p = camera.position;
  return {means.data(), nullptr, nullptr, static_cast<int>(3 * stored), means.shape(0), {p[0], p[1], p[2]}, degree};
}

void colors(const Points& means, const Points& constant, const Rest& rest, const Camera& camera, int degree,
            const PointsOut& out, const std::optional<Array>& slopes) {
  Harmonics table = as_table(means, rest.shape(1), camera, degree);
  require(constant.shape(0) == table.count && rest.shape(0) == table.count && out.shape(0) == table.count,
          "sh_colors: all columns must have the same number of rows");
  require(!slopes || slopes->size() >= slope_count(table.count), "sh_colors: slopes must hold sh_slopes(rows) floats");
  table.constant = constant.data();
  table.rest = rest.data();
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(sh_colors)(table, out.data(), slopes ? slopes->data() : nullptr);
}

using Matrix = Tensor<const float, -1, -1>;
using MatrixOut = Tensor<float, -1, -1>;

SharedBasis as_basis(const Harmonics& table, const Matrix& weights, const Rest& basis) {
  const std::size_t count = basis.shape(0);
  require(count >= 1 && count <= convention::SH_MAX_BASIS, "sh_basis: a basis has 1 to SH_MAX_BASIS rows");
  require(3 * basis.shape(1) == SH_REST, "sh_basis: the basis must be [K 15 3]");
  require(weights.shape(0) == table.count && weights.shape(1) == count, "sh_basis: weights must be [N K]");
  return {weights.data(), basis.data(), static_cast<int>(count)};
}

void basis_colors(const Points& means, const Points& constant, const Matrix& weights, const Rest& basis,
                  const Camera& camera, int degree, const PointsOut& out, const std::optional<Array>& slopes,
                  bool by_logits) {
  Harmonics table = as_table(means, SH_REST / 3, camera, degree);
  const SharedBasis mixed = as_basis(table, weights, basis);
  require(constant.shape(0) == table.count && out.shape(0) == table.count,
          "sh_basis_colors: all columns must have the same number of rows");
  require(!slopes || slopes->size() >= slope_count(table.count),
          "sh_basis_colors: slopes must hold sh_slopes(rows) floats");
  table.constant = constant.data();
  table.by_logits = by_logits;
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(sh_basis_colors)(table, mixed, out.data(), slopes ? slopes->data() : nullptr);
}

void basis_gradient(const Points& means, const Camera& camera, int degree, const Points& by_constant,
                    const Matrix& weights, const Rest& basis, const MatrixOut& by_weights, const RestOut& by_basis) {
  const Harmonics table = as_table(means, SH_REST / 3, camera, degree);
  const SharedBasis mixed = as_basis(table, weights, basis);
  require(by_constant.shape(0) == table.count, "sh_basis_gradient: by_constant must have one row per Gaussian");
  require(by_weights.shape(0) == table.count && by_weights.shape(1) == weights.shape(1),
          "sh_basis_gradient: by_weights must be like weights");
  require(by_basis.shape(0) == basis.shape(0) && by_basis.shape(1) == basis.shape(1),
          "sh_basis_gradient: by_basis must be like basis");
  const nb::gil_scoped_release unlocked;
  const auto run = RINGLIGHT_CHOSEN(sh_basis_gradient);
  run(table, mixed, by_constant.data(), by_weights.data(), by_basis.data());
}

void gradient(const Points& upstream, const Points& colors, const Input& slopes, const PointsOut& by_means,
              const PointsOut& by_constant, bool add) {
  const std::size_t count = upstream.shape(0);
  require(colors.shape(0) == count && by_means.shape(0) == count && by_constant.shape(0) == count,
          "sh_gradient: all gradients must have one row per Gaussian");
  require(slopes.size() >= slope_count(count), "sh_gradient: slopes must be those of sh_colors");
  const HarmonicsUpstream from{upstream.data(), colors.data(), slopes.data(), count};
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(sh_gradient)(from, {by_means.data(), by_constant.data(), add});
}

void rest_gradient(const Points& means, const Camera& camera, int degree, const Points& by_constant,
                   const RestOut& by_rest) {
  const Harmonics table = as_table(means, by_rest.shape(1), camera, degree);
  require(by_constant.shape(0) == table.count && by_rest.shape(0) == table.count,
          "sh_rest_gradient: all columns must have the same number of rows");
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(sh_rest_gradient)(table, by_constant.data(), by_rest.data());
}

std::size_t rest_adam(const Points& means, const Camera& camera, int degree, const Points& by_constant,
                      const RestOut& rest, const RestOut& mean, const RestOut& square,
                      const std::tuple<float, float, float, float, long>& step) {
  const Harmonics table = as_table(means, rest.shape(1), camera, degree);
  require(mean.shape(1) == rest.shape(1) && square.shape(1) == rest.shape(1),
          "sh_rest_adam: value and moments must have the same number of harmonics");
  require(by_constant.shape(0) == table.count && rest.shape(0) == table.count && mean.shape(0) == table.count &&
              square.shape(0) == table.count,
          "sh_rest_adam: value, moments and gradient must have the same number of rows");
  const auto [rate, beta1, beta2, epsilon, number] = step;
  require(number >= 1, "sh_rest_adam: steps count from 1");
  const nb::gil_scoped_release unlocked;
  const auto run = RINGLIGHT_CHOSEN(sh_rest_adam);
  return run(table, by_constant.data(), {rest.data(), mean.data(), square.data()},
             {rate, beta1, beta2, epsilon, number});
}

DirectionalOpacities as_opacities(const Points& means, const Tensor<const float, -1>& logits, const Matrix& rest,
                                  const Camera& camera, int degree, float least) {
  Harmonics table = as_table(means, rest.shape(1), camera, degree);
  require(logits.shape(0) == table.count && rest.shape(0) == table.count,
          "sh_opacity: all columns must have the same number of rows");
  require(least > 0, "sh_opacity: the least opacity must be positive");
  table.rest = rest.data();
  table.stored = static_cast<int>(rest.shape(1));
  return {table, logits.data(), least};
}

void opacity_factors(const Points& means, const Tensor<const float, -1>& logits, const Matrix& rest,
                     const Camera& camera, int degree, float least, const Tensor<float, -1>& factors) {
  const DirectionalOpacities table = as_opacities(means, logits, rest, camera, degree, least);
  require(factors.shape(0) == table.harmonics.count, "sh_opacity_factors: there must be a factor for each row");
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(sh_opacity_factors)(table, factors.data());
}

void opacity_gradient(const Points& means, const Tensor<const float, -1>& logits, const Matrix& rest,
                      const Camera& camera, int degree, float least, const Tensor<const float, -1>& by_factors,
                      const PointsOut& by_means, const Tensor<float, -1>& by_logits, const MatrixOut& by_rest) {
  const DirectionalOpacities table = as_opacities(means, logits, rest, camera, degree, least);
  const std::size_t count = table.harmonics.count;
  require(by_factors.shape(0) == count && by_means.shape(0) == count && by_logits.shape(0) == count &&
              by_rest.shape(0) == count,
          "sh_opacity_gradient: all gradients must have one row per Gaussian");
  require(by_rest.shape(1) == rest.shape(1), "sh_opacity_gradient: by_rest must be like rest");
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(sh_opacity_gradient)
  (table, by_factors.data(), {by_means.data(), by_logits.data(), by_rest.data()});
}

DirectionalOpacities as_mixed_opacities(const Points& means, const Tensor<const float, -1>& logits,
                                        const Camera& camera, int degree, float least) {
  const Harmonics table = as_table(means, SH_REST / 3, camera, degree);
  require(logits.shape(0) == table.count, "sh_basis_opacity: all columns must have the same number of rows");
  require(least > 0, "sh_basis_opacity: the least opacity must be positive");
  return {table, logits.data(), least};
}

SharedBasis as_opacity_basis(std::size_t rows, const Matrix& weights, const Matrix& basis) {
  const std::size_t count = basis.shape(0);
  require(count >= 1 && count <= convention::SH_MAX_BASIS, "sh_basis_opacity: a basis has 1 to SH_MAX_BASIS rows");
  require(3 * basis.shape(1) == SH_REST, "sh_basis_opacity: the basis must be [K 15]");
  require(weights.shape(0) == rows && weights.shape(1) == count, "sh_basis_opacity: weights must be [N K]");
  return {weights.data(), basis.data(), static_cast<int>(count)};
}

void basis_opacity_factors(const Points& means, const Tensor<const float, -1>& logits, const Matrix& weights,
                           const Matrix& basis, const Camera& camera, int degree, float least,
                           const Tensor<float, -1>& factors) {
  const DirectionalOpacities table = as_mixed_opacities(means, logits, camera, degree, least);
  const SharedBasis mixed = as_opacity_basis(table.harmonics.count, weights, basis);
  require(factors.shape(0) == table.harmonics.count, "sh_basis_opacity: there must be a factor for each row");
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(sh_basis_opacity_factors)(table, mixed, factors.data());
}

void basis_opacity_gradient(const Points& means, const Tensor<const float, -1>& logits, const Matrix& weights,
                            const Matrix& basis, const Camera& camera, int degree, float least,
                            const Tensor<const float, -1>& by_factors, const PointsOut& by_means,
                            const Tensor<float, -1>& by_logits, const MatrixOut& by_weights,
                            const MatrixOut& by_basis) {
  const DirectionalOpacities table = as_mixed_opacities(means, logits, camera, degree, least);
  const std::size_t count = table.harmonics.count;
  const SharedBasis mixed = as_opacity_basis(count, weights, basis);
  require(by_factors.shape(0) == count && by_means.shape(0) == count && by_logits.shape(0) == count,
          "sh_basis_opacity: all gradients must have one row per Gaussian");
  require(by_weights.shape(0) == count && by_weights.shape(1) == weights.shape(1) &&
              by_basis.shape(0) == basis.shape(0) && by_basis.shape(1) == basis.shape(1),
          "sh_basis_opacity: by_weights and by_basis must be like weights and basis");
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(sh_basis_opacity_gradient)
  (table, mixed, by_factors.data(), {by_means.data(), by_logits.data(), by_weights.data(), by_basis.data()});
}

}  // namespace

void bind_sh(nb::module_& module) {
  module.def("sh_slopes", &slope_count, "rows"_a, "Floats that sh_colors leaves for sh_gradient.");
  module.def("sh_colors", &colors, "means"_a, "constant"_a, "rest"_a, "camera"_a, "degree"_a, "colors"_a,
             "slopes"_a.none() = nb::none(),
             "Fill colors [N 3], clamped at black (a clamped one is -0), towards the camera.");
  module.def("sh_gradient", &gradient, "upstream"_a, "colors"_a, "slopes"_a, "by_means"_a, "by_constant"_a,
             "add"_a,
             "Fill by_constant with the gradient of sh_colors; by_means too, or add to it.");
  module.def("sh_basis_colors", &basis_colors, "means"_a, "constant"_a, "weights"_a, "basis"_a, "camera"_a, "degree"_a,
             "colors"_a, "slopes"_a.none() = nb::none(), "by_logits"_a = false,
             "sh_colors of rest = weights basis, which is never written: weights [N K], basis [K 15 3]. With by_logits "
             "`constant` holds logits of the colour that harmonics are added to.");
  module.def("sh_basis_gradient", &basis_gradient, "means"_a, "camera"_a, "degree"_a, "by_constant"_a, "weights"_a,
             "basis"_a, "by_weights"_a, "by_basis"_a,
             "Fill by_weights and by_basis from what sh_gradient left in by_constant.");
  module.def("sh_rest_gradient", &rest_gradient, "means"_a, "camera"_a, "degree"_a, "by_constant"_a, "by_rest"_a,
             "Fill by_rest from what sh_gradient left in by_constant; zero above the degree.");
  module.def("sh_rest_adam", &rest_adam, "means"_a, "camera"_a, "degree"_a, "by_constant"_a, "rest"_a, "mean"_a,
             "square"_a, "step"_a,
             "adam of rest with the gradient of sh_rest_gradient, in place.");
  module.def("sh_opacity_factors", &opacity_factors, "means"_a, "logits"_a, "rest"_a, "camera"_a, "degree"_a, "least"_a,
             "factors"_a,
             "Fill factors [N]: sigmoid(logits) plus harmonics rest [N K], clamped to [0, 1], over sigmoid(logits).");
  module.def("sh_opacity_gradient", &opacity_gradient, "means"_a, "logits"_a, "rest"_a, "camera"_a, "degree"_a,
             "least"_a, "by_factors"_a, "by_means"_a, "by_logits"_a, "by_rest"_a,
             "Gradient of sh_opacity_factors: add to by_means and by_logits, fill by_rest.");
  module.def("sh_basis_opacity_factors", &basis_opacity_factors, "means"_a, "logits"_a, "weights"_a, "basis"_a,
             "camera"_a, "degree"_a, "least"_a, "factors"_a,
             "Fill factors [N]: sigmoid(logits + harmonics of weights basis) over sigmoid(logits); basis [K 15].");
  module.def("sh_basis_opacity_gradient", &basis_opacity_gradient, "means"_a, "logits"_a, "weights"_a, "basis"_a,
             "camera"_a, "degree"_a, "least"_a, "by_factors"_a, "by_means"_a, "by_logits"_a, "by_weights"_a,
             "by_basis"_a,
             "Gradient of sh_basis_opacity_factors: add to by_means, by_logits and by_weights, fill by_basis.");
}

}  // namespace ringlight
