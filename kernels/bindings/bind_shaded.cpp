#include <algorithm>
#include <memory>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "convention.hpp"
#include "environment/shaded_rows.hpp"
#include "environment/sparse_rows.hpp"

namespace ringlight {
namespace {

using Rows3 = Tensor<const float, -1, 3>;
using Rows4 = Tensor<const float, -1, 4>;
using Rows6 = Tensor<const float, -1, 6>;
using Column = Tensor<const float, -1>;
using Texels = Tensor<const float, -1, TEXEL>;

// A sparse matrix, looked at once.
class SparseMatrix {
 public:
  SparseMatrix(Tensor<const std::int32_t, -1> starts, Tensor<const std::int32_t, -1> sources, Column weights,
               std::int64_t width)
      : starts_(starts), sources_(sources), weights_(weights), width_(static_cast<std::size_t>(width)) {
    const std::size_t entries = sources.shape(0);
    require(starts.shape(0) >= 1 && weights.shape(0) == entries, "sparse matrix: arrays do not fit");
    const std::int32_t *begin = starts.data(), *end = begin + starts.shape(0);
    require(*begin == 0 && static_cast<std::size_t>(end[-1]) == entries && std::is_sorted(begin, end),
            "sparse matrix: starts must rise from 0 to the number of entries");
    require(std::all_of(sources.data(), sources.data() + entries,
                        [=](std::int32_t source) { return source >= 0 && source < width; }),
            "sparse matrix: an entry names a source that is not there");
  }

  SparseRows rows() const { return {starts_.shape(0) - 1, starts_.data(), sources_.data(), weights_.data()}; }
  std::size_t width() const { return width_; }

 private:
  Tensor<const std::int32_t, -1> starts_, sources_;
  Column weights_;
  std::size_t width_;
};

void product(const SparseMatrix& matrix, Texels values, Tensor<float, -1, TEXEL> sums) {
  const SparseRows rows = matrix.rows();
  require(values.shape(0) == matrix.width() && sums.shape(0) == rows.count,
          "sparse_product: values must have a row for each source, sums one for each row");
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(sparse_product)(rows, values.data(), sums.data());
}

LightLevels levels_of(const Tensor<const std::int64_t, -1>& sides, const Column& roughness) {
  LightLevels levels;
  const std::size_t count = roughness.shape(0);
  require(count >= 2 && count <= convention::SHADED_MAX_LEVELS, "shaded: a light has 2 to 12 levels of roughness");
  require(sides.shape(0) == count + 1, "shaded: each level has a side, and so has diffuse light");
  levels.count = static_cast<int>(count);
  for (std::size_t i = 0; i <= count; i++) {
    const std::int64_t side = sides.data()[i];
    require(side >= 1 && side <= convention::ENVIRONMENT_MAX_SIDE, "shaded: a level has faces of 1 to 1024 texels");
    levels.sides[i] = static_cast<int>(side);
    if (i == count) break;
    levels.roughness[i] = roughness.data()[i];
    require(i == 0 || levels.roughness[i] > levels.roughness[i - 1], "shaded: the levels' roughness must rise");
  }
  require(levels.texels() < (1u << 24), "shaded: a light's levels have too many texels together");
  return levels;
}

// The Gaussians and their light, kept from the way there to the way back.
class ShadedJob {
 public:
  ShadedJob(Rows3 means, Rows3 log_scales, Rows4 quats, Rows3 bases, Rows3 tints, Column roughness, Rows6 residuals,
            const Camera& camera, float smallest_quaternion, float smallest_length, float smoothest, bool ambient,
            Tensor<const std::int64_t, -1> sides, Column level_roughness, Texels maps,
            Tensor<const float, -1, -1, 2> shares)
      : means_(means), log_scales_(log_scales), quats_(quats), bases_(bases), tints_(tints), roughness_(roughness),
        residuals_(residuals), camera_(camera), smallest_quaternion_(smallest_quaternion),
        smallest_length_(smallest_length), smoothest_(smoothest), ambient_(ambient),
        levels_(levels_of(sides, level_roughness)), maps_(maps), shares_(shares) {
    const std::size_t rows = count();
    require(log_scales.shape(0) == rows && quats.shape(0) == rows && bases.shape(0) == rows &&
                tints.shape(0) == rows && roughness.shape(0) == rows && residuals.shape(0) == rows,
            "shaded: columns must have the same rows");
    require(maps.shape(0) == levels_.texels(), "shaded: maps must have the texels of their sides");
    require(shares.shape(0) == shares.shape(1) && shares.shape(0) >= 2 && shares.shape(0) <= 1024,
            "shaded: the table of shares must be [S S 2], S from 2 to 1024");
  }

  std::size_t count() const { return means_.shape(0); }
  const LightLevels& levels() const { return levels_; }
  const float* maps() const { return maps_.data(); }
  SpecularTable table() const { return {static_cast<int>(shares_.shape(0)), shares_.data()}; }

  ShadedRows rows(std::size_t width) const {
    require(width == PLAIN_WIDTH || width == SURFACE_WIDTH, "shaded: channels are rgb, or rgb, normal and depth");
    const SurfaceRows surface{count(), means_.data(), log_scales_.data(), quats_.data(), nullptr,
                              camera_.position, smallest_quaternion_};
    return {surface, camera_, smallest_length_, smoothest_, ambient_, static_cast<int>(width),
            bases_.data(), tints_.data(), roughness_.data(), residuals_.data()};
  }

 private:
  Rows3 means_, log_scales_;
  Rows4 quats_;
  Rows3 bases_, tints_;
  Column roughness_;
  Rows6 residuals_;
  Camera camera_;
  float smallest_quaternion_, smallest_length_, smoothest_;
  bool ambient_;
  LightLevels levels_;
  Texels maps_;
  Tensor<const float, -1, -1, 2> shares_;
};

void forward(const ShadedJob& job, Tensor<float, -1, -1> channels) {
  require(channels.shape(0) == job.count(), "shaded: channels must have a row for each of the columns");
  const ShadedRows rows = job.rows(channels.shape(1));
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(shaded_forward)(rows, job.levels(), job.table(), job.maps(), channels.data());
}

void backward(const ShadedJob& job, Tensor<const float, -1, -1> of_channels, Tensor<float, -1, 3> of_means,
              Tensor<float, -1, 4> of_quats, Tensor<float, -1, 3> of_bases, Tensor<float, -1, 3> of_tints,
              Tensor<float, -1> of_roughness, Tensor<float, -1, 6> of_residuals, Tensor<float, -1, TEXEL> of_maps) {
  const std::size_t count = job.count();
  require(of_channels.shape(0) == count && of_means.shape(0) == count && of_quats.shape(0) == count &&
              of_bases.shape(0) == count && of_tints.shape(0) == count && of_roughness.shape(0) == count &&
              of_residuals.shape(0) == count,
          "shaded: gradients must have a row for each of the columns");
  const std::size_t floats = job.levels().texels() * TEXEL;
  require(of_maps.size() == floats, "shaded: the gradient of maps must have their texels");
  const ShadedRows rows = job.rows(of_channels.shape(1));
  const nb::gil_scoped_release unlocked;
  const std::unique_ptr<float[]> shards(new float[TEXEL_SHARDS * floats]);
  const ShadedGradients to{of_means.data(), of_quats.data(), of_bases.data(), of_tints.data(), of_roughness.data(),
                           of_residuals.data()};
  RINGLIGHT_CHOSEN(shaded_backward)
  (rows, job.levels(), job.table(), job.maps(), of_channels.data(), to, shards.get());
  RINGLIGHT_CHOSEN(add_shards)(floats, shards.get());
  std::copy_n(shards.get(), floats, of_maps.data());
}

}  // namespace

void bind_shaded(nb::module_& module) {
  nb::class_<SparseMatrix>(module, "SparseMatrix",
                           "Row i holds the entries from starts[i] to starts[i + 1]; it keeps the arrays.")
      .def(nb::init<Tensor<const std::int32_t, -1>, Tensor<const std::int32_t, -1>, Column, std::int64_t>(),
           "starts"_a, "sources"_a, "weights"_a, "width"_a);
  module.def("sparse_product", &product, "matrix"_a, "values"_a, "sums"_a, "The matrix times rows of four.");
  nb::class_<ShadedJob>(module, "ShadedJob", "Gaussians, their camera and their light; it keeps the arrays.")
      .def(nb::init<Rows3, Rows3, Rows4, Rows3, Rows3, Column, Rows6, const Camera&, float, float, float, bool,
                    Tensor<const std::int64_t, -1>, Column, Texels, Tensor<const float, -1, -1, 2>>(),
           nb::kw_only(), "means"_a, "log_scales"_a, "quats"_a, "bases"_a, "tints"_a, "roughness"_a, "residuals"_a,
           "camera"_a, "smallest_quaternion"_a, "smallest_length"_a, "smoothest"_a, "ambient"_a, "sides"_a,
           "level_roughness"_a, "maps"_a, "shares"_a);
  module.def("shaded_forward", &forward, "job"_a, "channels"_a,
             "Colour of each Gaussian, and normal and depth where there is room for them, side by side.");
  module.def("shaded_backward", &backward, "job"_a, "of_channels"_a, "of_means"_a, "of_quats"_a, "of_bases"_a,
             "of_tints"_a, "of_roughness"_a, "of_residuals"_a, "of_maps"_a,
             "Gradients of the columns and of the maps' texels.");
}

}  // namespace ringlight
