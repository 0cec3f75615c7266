#include <algorithm>
#include <memory>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "convention.hpp"
#include "environment/environment.hpp"
#include "environment/surface_channels.hpp"

namespace ringlight {
namespace {

using Rows3 = Tensor<const float, -1, 3>;
using Logits = Tensor<const float, FACES, -1, -1, 3>;
using Colors = Tensor<float, FACES, -1, -1, TEXEL>;
using Numbers = Tensor<const std::int64_t>;

CubemapSize size_of(std::size_t rows, std::size_t columns) {
  require(rows == columns && rows >= 1 && rows <= convention::ENVIRONMENT_MAX_SIDE,
           "a cubemap has square faces of 1 to 1024 texels a side");
  return {static_cast<int>(rows)};
}

template <class Float>
void require_bordered(const CubemapSize& size, const Tensor<Float, FACES, -1, -1, TEXEL>& colors) {
  const std::size_t wide = size.wide();
  require(colors.shape(1) == wide && colors.shape(2) == wide, "a cubemap's colours must be [6 S+2 S+2 4]");
}

CubemapBorder border_of(const CubemapSize& size, const Numbers& places, const Numbers& sources) {
  const std::int64_t texels = FACES * size.side * size.side, all = FACES * size.wide() * size.wide();
  require(sources.size() == 3 * places.size(), "each place of a cubemap's border has three sources");
  const auto within = [](const Numbers& numbers, std::int64_t most) {
    return std::all_of(numbers.data(), numbers.data() + numbers.size(),
                       [=](std::int64_t number) { return number >= 0 && number < most; });
  };
  require(within(places, all) && within(sources, texels), "a cubemap's border names a texel that is not there");
  return {places.size(), places.data(), sources.data()};
}

void colors_of(Logits logits, Numbers places, Numbers sources, Colors colors) {
  const CubemapSize size = size_of(logits.shape(1), logits.shape(2));
  require_bordered(size, colors);
  const CubemapBorder border = border_of(size, places, sources);
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(cubemap_colors)(size, border, logits.data(), colors.data());
}

EnvironmentPlanes planes_of(const Camera& camera, const Input& image, const Input& alpha) {
  require(std::min(camera.width, camera.height) >= 1 &&
              std::max(camera.width, camera.height) <= convention::MAX_IMAGE_SIDE,
          "environment: the picture has no pixels or too many");
  const std::size_t pixels = static_cast<std::size_t>(camera.width) * camera.height;
  require(image.size() == 7 * pixels && alpha.size() == pixels, "environment: image must be [7 H W], alpha [1 H W]");
  return {image.data(), alpha.data()};
}

void forward(const EnvironmentView& view, Tensor<const float, FACES, -1, -1, TEXEL> colors, Input image, Input alpha,
             Array color) {
  const CubemapSize size = size_of(colors.shape(1) - 2, colors.shape(2) - 2);
  const EnvironmentPlanes planes = planes_of(view.camera, image, alpha);
  require(7 * color.size() == 3 * image.size(), "environment: color must be [3 H W]");
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(environment_forward)(view, size, planes, colors.data(), color.data());
}

void backward(const EnvironmentView& view, Tensor<const float, FACES, -1, -1, TEXEL> colors, Numbers places,
              Numbers sources, Input image, Input alpha, Input of_color, Array of_image,
              Tensor<float, FACES, -1, -1, 3> of_logits) {
  const CubemapSize size = size_of(of_logits.shape(1), of_logits.shape(2));
  require_bordered(size, colors);
  const CubemapBorder border = border_of(size, places, sources);
  const EnvironmentPlanes planes = planes_of(view.camera, image, alpha);
  require(7 * of_color.size() == 3 * image.size(), "environment: the gradient of color must be [3 H W]");
  require(of_image.size() == image.size(), "environment: the gradient of image must be [7 H W]");
  const nb::gil_scoped_release unlocked;
  const std::unique_ptr<float[]> shards(new float[TEXEL_SHARDS * size.floats()]);
  RINGLIGHT_CHOSEN(environment_backward)
  (view, size, planes, colors.data(), of_color.data(), of_image.data(), shards.get());
  RINGLIGHT_CHOSEN(cubemap_gradient)(size, border, colors.data(), shards.get(), of_logits.data());
}

SurfaceRows rows_from(const Rows3& means, const Rows3& log_scales, const Tensor<const float, -1, 4>& quats,
                      const Tensor<const float, -1>& strengths, const Camera& camera, float smallest_length) {
  const std::size_t count = means.shape(0);
  require(log_scales.shape(0) == count && quats.shape(0) == count && strengths.shape(0) == count,
          "surface_channels: columns must have the same rows");
  return {count, means.data(), log_scales.data(), quats.data(), strengths.data(), camera.position, smallest_length};
}

void surface_forward(Rows3 means, Rows3 log_scales, Tensor<const float, -1, 4> quats,
                     Tensor<const float, -1> strengths, const Camera& camera, float smallest_length, Rows3 colors,
                     Tensor<float, -1, 7> channels) {
  const SurfaceRows rows = rows_from(means, log_scales, quats, strengths, camera, smallest_length);
  require(colors.shape(0) == rows.count && channels.shape(0) == rows.count,
          "surface_channels: colors and channels must have a row for each of the columns");
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(surface_channels)(rows, colors.data(), channels.data());
}

void surface_backward(Rows3 means, Rows3 log_scales, Tensor<const float, -1, 4> quats,
                      Tensor<const float, -1> strengths, const Camera& camera, float smallest_length,
                      Tensor<const float, -1, 7> of_channels, Tensor<float, -1, 3> of_colors,
                      Tensor<float, -1, 4> of_quats, Tensor<float, -1> of_strengths) {
  const SurfaceRows rows = rows_from(means, log_scales, quats, strengths, camera, smallest_length);
  require(of_channels.shape(0) == rows.count && of_colors.shape(0) == rows.count &&
              of_quats.shape(0) == rows.count && of_strengths.shape(0) == rows.count,
          "surface_gradient: gradients must have a row for each of the columns");
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(surface_gradient)
  (rows, of_channels.data(), {of_colors.data(), of_quats.data(), of_strengths.data()});
}

}  // namespace

void bind_environment(nb::module_& module) {
  nb::class_<EnvironmentView>(module, "EnvironmentView", "From where, and the bounds that shade/covered.py explains.")
      .def(nb::init<Camera, float, float>(), nb::kw_only(), "camera"_a, "faintest"_a, "shortest_normal"_a);
  module.def("cubemap_colors", &colors_of, "logits"_a, "places"_a, "sources"_a, "colors"_a,
             "Colours [6 S+2 S+2 4] of logits [6 S S 3], with the border of fields/cubemap.py.");
  module.def("environment_forward", &forward, "view"_a, "colors"_a, "image"_a, "alpha"_a, "color"_a,
             "Shaded colour of each pixel from rgb, normal and strength.");
  module.def("environment_backward", &backward, "view"_a, "colors"_a, "places"_a, "sources"_a, "image"_a, "alpha"_a,
             "of_color"_a, "of_image"_a, "of_logits"_a, "Gradients of the image and of the cubemap's logits.");
  module.def("surface_channels", &surface_forward, "means"_a, "log_scales"_a, "quats"_a, "strengths"_a, "camera"_a,
             "smallest_length"_a, "colors"_a, "channels"_a,
             "Base colour, shortest axis towards the camera and strength of each Gaussian, side by side.");
  module.def("surface_gradient", &surface_backward, "means"_a, "log_scales"_a, "quats"_a, "strengths"_a, "camera"_a,
             "smallest_length"_a, "of_channels"_a, "of_colors"_a, "of_quats"_a, "of_strengths"_a,
             "Gradients of base colours, quaternions and strengths.");
}

}  // namespace ringlight
