#include <nanobind/stl/array.h>

#include <algorithm>
#include <array>
#include <memory>

#include "bindings/bindings.hpp"
#include "bindings/perceptron_inputs.hpp"
#include "bindings/plane_inputs.hpp"
#include "illuminated/illuminated.hpp"
#include "simd/dispatch.hpp"

namespace ringlight {
namespace {

using Column = Tensor<const float, -1>;
using Matrix = Tensor<const float, -1, -1>;
using Numbers = Tensor<const std::int32_t, -1>;
using Triple = std::array<float, 3>;

// Gaussians in one view and the field that lights them, kept from the way there to the way back.
class IlluminatedJob {
 public:
  IlluminatedJob(Planes<const float> planes, Lines<const float> lines, Matrix mix, Column offset,
                 std::vector<Input> parameters, Tensor<const float, CODE_PAIRS, HIGHEST_LEVEL + 1> polynomials,
                 Tensor<const float, -1, 3> means, Column roughness, Matrix features, Numbers rows, Triple low,
                 Triple scale, Triple position, float smallest_length, float roughness_shift)
      : planes_(planes), lines_(lines), mix_(mix), offset_(offset), parameters_(parameters),
        polynomials_(polynomials), means_(means), roughness_(roughness), features_(features), rows_(rows), low_(low),
        scale_(scale), position_(position), smallest_length_(smallest_length), roughness_shift_(roughness_shift),
        shape_(shape_of(planes, lines)) {
    constexpr std::size_t MOST_ROWS = std::size_t{1} << 30;  // numbers of rows fit an int
    const std::size_t known = means.shape(0), width = features.shape(1), hidden = parameters.size() == 6 ?
        parameters[1].size() : 0;
    require(std::max(known, rows.shape(0)) < MOST_ROWS, "illuminated: there are too many rows");
    require(roughness.shape(0) == known && features.shape(0) == known,
            "illuminated: columns must have the same rows");
    require(mix.shape(0) == width && offset.shape(0) == width &&
                mix.shape(1) == static_cast<std::size_t>(PLANE_PAIRS * shape_.channels),
            "illuminated: the mix must be [features 3C], its offset [features]");
    require(width >= 1 && width <= convention::PLANES_MAX_CHANNELS && hidden >= 1 && hidden <= 1u << 14,
            "illuminated: a width is 0 or too large");
    network_ = {1, 0, static_cast<int>(2 * width + VIEW_WIDTH), static_cast<int>(hidden), LIT_WIDTH};
    layers_from<const float>(network_, parameters_);
    require(std::all_of(rows.data(), rows.data() + rows.shape(0),
                        [=](std::int32_t row) { return row >= 0 && static_cast<std::size_t>(row) < known; }),
            "illuminated: a row is not one of the columns'");
  }

  std::size_t count() const { return rows_.shape(0); }
  std::size_t known() const { return means_.shape(0); }
  const std::int32_t* rows() const { return rows_.data(); }

  LightField field() const {
    return {shape_,        grids_of(planes_, lines_), static_cast<int>(features_.shape(1)),     mix_.data(),
            offset_.data(), network_,                  layers_from<const float>(network_, parameters_),
            polynomials_.data()};
  }
  LitGaussians gaussians(std::size_t count, const std::int32_t* rows) const {
    return {count,
            rows,
            means_.data(),
            roughness_.data(),
            features_.data(),
            {low_[0], low_[1], low_[2]},
            {scale_[0], scale_[1], scale_[2]},
            {position_[0], position_[1], position_[2]},
            smallest_length_,
            roughness_shift_};
  }

 private:
  Planes<const float> planes_;
  Lines<const float> lines_;
  Matrix mix_;
  Column offset_;
  std::vector<Input> parameters_;
  Tensor<const float, CODE_PAIRS, HIGHEST_LEVEL + 1> polynomials_;
  Tensor<const float, -1, 3> means_;
  Column roughness_;
  Matrix features_;
  Numbers rows_;
  Triple low_, scale_, position_;
  float smallest_length_, roughness_shift_;
  PlaneShape shape_;
  PerceptronShape network_;
};

void forward(const IlluminatedJob& job, Tensor<float, -1, 3> specular) {
  require(specular.shape(0) == job.count(), "illuminated: there must be a result for each lit row");
  if (job.count() == 0) return;
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN_WITH_BF16(light_forward)(job.field(), job.gaussians(job.count(), job.rows()), specular.data());
}

std::size_t backward(const IlluminatedJob& job, Tensor<const float, -1, 3> of_specular, double share,
                     Tensor<float, -1> of_roughness, Tensor<float, -1, -1> of_features,
                     const std::vector<Array>& of_parameters, Tensor<float, -1, -1> of_mix, Tensor<float, -1> of_offset,
                     const Planes<float>& of_planes, const Lines<float>& of_lines) {
  const LightField field = job.field();
  const std::size_t width = field.features, joined = field.joined(), count = job.count();
  require(share > 0, "illuminated: the share must be above 0");
  require(of_specular.shape(0) == count, "illuminated: there must be a gradient for each lit row");
  require(of_roughness.shape(0) == job.known() && of_features.shape(0) == job.known() &&
              of_features.shape(1) == width && of_mix.shape(0) == width && of_mix.shape(1) == joined &&
              of_offset.shape(0) == width,
          "illuminated: gradients must be like their values");
  require(same(field.shape, shape_of(of_planes, of_lines)), "illuminated: gradients must have their grids' sizes");
  const auto of_layers = layers_from<float>(field.network, of_parameters);
  const auto of_grids = grids_of(of_planes, of_lines);
  const nb::gil_scoped_release unlocked;
  const std::unique_ptr<std::int32_t[]> rows(new std::int32_t[count]);
  const std::unique_ptr<float[]> weights(new float[count]);
  const std::size_t drawn = RINGLIGHT_CHOSEN_WITH_BF16(draw_lit_rows)(share, count, of_specular.data(), rows.get(),
                                                                      weights.get());
  if (drawn == 0) return 0;
  const std::unique_ptr<float[]> upstream(new float[3 * drawn]), points(new float[3 * drawn]),
      of_products(new float[joined * drawn]);
  for (std::size_t i = 0; i < drawn; i++) {
    const float* const from = of_specular.data() + 3 * static_cast<std::size_t>(rows[i]);
    for (int c = 0; c < 3; c++) upstream[3 * i + c] = from[c] * weights[i];
    rows[i] = job.rows()[rows[i]];
  }
  const LightGradients to{of_roughness.data(), of_features.data(), of_layers,    of_mix.data(),
                          of_offset.data(),    points.get(),       of_products.get()};
  RINGLIGHT_CHOSEN_WITH_BF16(light_backward)(field, job.gaussians(drawn, rows.get()), upstream.get(), to);
  RINGLIGHT_CHOSEN(plane_gradient)(field.shape, field.grids, drawn, points.get(), of_products.get(), of_grids);
  return drawn;
}

}  // namespace

void bind_illuminated(nb::module_& module) {
  nb::class_<IlluminatedJob>(module, "IlluminatedJob", "Gaussians in a view, and their light; it keeps the arrays.")
      .def(nb::init<Planes<const float>, Lines<const float>, Matrix, Column, std::vector<Input>,
                    Tensor<const float, CODE_PAIRS, HIGHEST_LEVEL + 1>, Tensor<const float, -1, 3>, Column, Matrix,
                    Numbers, Triple, Triple, Triple, float, float>(),
           nb::kw_only(), "planes"_a, "lines"_a, "mix"_a, "offset"_a, "parameters"_a, "polynomials"_a, "means"_a,
           "roughness"_a, "features"_a, "rows"_a, "low"_a, "scale"_a, "position"_a, "smallest_length"_a,
           "roughness_shift"_a);
  module.def("illuminated_forward", &forward, "job"_a, "specular"_a, "What the light adds to the lit rows.");
  module.def("illuminated_backward", &backward, "job"_a, "of_specular"_a, "share"_a, nb::kw_only(), "of_roughness"_a,
             "of_features"_a, "of_parameters"_a, "of_mix"_a, "of_offset"_a, "of_planes"_a, "of_lines"_a,
             "Gradients of a share of the lit rows, drawn by importance; returns how many. Nothing is written if that "
             "is 0, and of columns only the drawn rows.");
}

}  // namespace ringlight
