// The rasterizer for Python: shapes are checked here, then the lock is released and pointers go down.
#include <nanobind/nanobind.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <optional>
#include <utility>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "bindings/picture_shader.hpp"
#include "raster/pairs.hpp"
#include "raster/rasterizer.hpp"

namespace ringlight {
namespace {

template <int... Sizes>
using In = Tensor<const float, Sizes...>;
template <int... Sizes>
using Out = Tensor<float, Sizes...>;

// A table and its channels, for one call: a tensor may be given other memory before the next (arrays.hpp).
struct Table {
  Table(In<-1, 3> means, In<-1, 3> log_scales, In<-1, 4> quats, In<-1> opacity_logits,
        std::optional<In<-1>> opacity_factor, In<-1, -1> channels, In<-1> background)
      : means(means), log_scales(log_scales), quats(quats), opacity_logits(opacity_logits),
        opacity_factor(opacity_factor), channels(channels), background(background) {}

  In<-1, 3> means, log_scales;
  In<-1, 4> quats;
  In<-1> opacity_logits;
  std::optional<In<-1>> opacity_factor;
  In<-1, -1> channels;
  In<-1> background;

  Splats splats() const {
    const std::size_t count = means.shape(0), width = channels.shape(1);
    require(log_scales.shape(0) == count && quats.shape(0) == count && opacity_logits.shape(0) == count &&
                channels.shape(0) == count && (!opacity_factor || opacity_factor->shape(0) == count),
            "rasterizer: all columns of the table must have the same number of rows");
    require(width >= 1 && background.shape(0) == width,
            "rasterizer: background needs one value per channel, and at least one");
    require(std::all_of(background.data(), background.data() + width, [](float v) { return std::isfinite(v); }),
            "rasterizer: the background must be finite");
    constexpr std::size_t MAX_CHANNELS = 1 << 16, MAX_ROWS = std::size_t{1} << 31;
    require(width <= MAX_CHANNELS && count < MAX_ROWS, "rasterizer: too many channels or rows");
    return {count, static_cast<int>(width), means.data(), log_scales.data(), quats.data(), opacity_logits.data(),
            opacity_factor ? opacity_factor->data() : nullptr, channels.data(), background.data()};
  }
};

bool is_finite(const Camera& camera) {
  const auto finite = [](float value) { return std::isfinite(value); };  // each: a sum may overflow
  const float lens[] = {camera.focal_x, camera.focal_y, camera.center_x, camera.center_y};
  return std::all_of(std::begin(lens), std::end(lens), finite) &&
         std::all_of(std::begin(camera.world_to_camera), std::end(camera.world_to_camera), finite);
}

RasterSettings settings_from(float eps2d, float near, float max_alpha, bool antialiased, bool absgrad) {
  require(eps2d >= 0 && near >= 0, "rasterizer: eps2d and near must not be negative");
  require(max_alpha > 0 && max_alpha < 1, "rasterizer: max_alpha must lie between 0 and 1");  // 1 would divide by zero
  return {eps2d, near, max_alpha, antialiased, absgrad};
}

template <class Array>
bool is_image(const Array& array, const Camera& camera) {
  const std::size_t last = array.ndim() - 1;
  return array.shape(last - 1) == static_cast<std::size_t>(camera.height) &&
         array.shape(last) == static_cast<std::size_t>(camera.width);
}

void forward(Workspace& workspace, const Table& table, const Camera& camera, const RasterSettings& settings,
             Out<-1, -1, -1> image, Out<-1, -1> alpha, Out<-1, 2> means2d, Out<-1, 2> radii,
             const LazyColors* lazy, const PictureShader* shader, std::optional<Out<-1, -1, -1>> blended,
             std::optional<Out<-1, -1, LANES>> tiles, bool early_stop) {
  require(is_finite(camera), "rasterizer: the camera must be finite");
  require(std::min(camera.width, camera.height) >= 1 &&
              std::max(camera.width, camera.height) <= convention::MAX_IMAGE_SIDE,
          "rasterizer: the image has no pixels, or too many on a side");
  const Splats splats = table.splats();
  const std::size_t channels = table.channels.shape(1);
  require(!lazy || (splats.channel_count == LAZY_CHANNELS && lazy->count == splats.count),
          "rasterizer: lazy colours are three for each row of the table");
  require(!shader || shader->channels() == channels, "rasterizer: the shader takes another number of channels");
  require(is_image(image, camera) && is_image(alpha, camera) && image.shape(0) == (shader ? 3 : channels),
          "rasterizer: image must be [C H W], or [3 H W] with a shader, and alpha [H W]");
  require(!blended || (shader && blended->shape(0) == channels && is_image(*blended, camera)),
          "rasterizer: what was blended goes with a shader, and must be [C H W]");
  require(!tiles || (shader && !blended && tiles->shape(1) == channels + 1 &&
                     tiles->shape(0) == tile_pixels(camera) / LANES),
          "rasterizer: tiles go with a shader, in place of what was blended, and must be [blocks C + 1 16]");
  require(means2d.shape(0) == splats.count && radii.shape(0) == splats.count,
          "rasterizer: footprints need one row per Gaussian");
  const nb::gil_scoped_release unlocked;
  const Images images{image.data(), alpha.data(), shader ? &shader->shader() : nullptr,
                      blended ? blended->data() : nullptr, tiles ? tiles->data() : nullptr, early_stop};
  workspace.forward(camera, settings, splats, images, {means2d.data(), radii.data()}, lazy);
}

struct Gradients {
  Gradients(Out<-1, 3> means, Out<-1, 3> log_scales, Out<-1, 4> quats, Out<-1> opacity_logits,
            std::optional<Out<-1>> opacity_factor, Out<-1, -1> channels, Out<-1, 2> means2d,
            std::optional<Out<-1, 2>> absolute)
      : means(means), log_scales(log_scales), quats(quats), opacity_logits(opacity_logits),
        opacity_factor(opacity_factor), channels(channels), means2d(means2d), absolute(absolute) {}

  Out<-1, 3> means, log_scales;
  Out<-1, 4> quats;
  Out<-1> opacity_logits;
  std::optional<Out<-1>> opacity_factor;
  Out<-1, -1> channels;
  Out<-1, 2> means2d;
  std::optional<Out<-1, 2>> absolute;

  SplatGradients pointers(const Splats& splats, bool absgrad) const {
    const std::size_t n = splats.count;
    require(means.shape(0) == n && log_scales.shape(0) == n && quats.shape(0) == n && opacity_logits.shape(0) == n &&
                channels.shape(0) == n && means2d.shape(0) == n && (!absolute || absolute->shape(0) == n) &&
                channels.shape(1) == static_cast<std::size_t>(splats.channel_count),
            "rasterizer: gradients must be shaped like the table");
    // An empty array may be a null pointer.
    require((n == 0 || opacity_factor.has_value() == (splats.opacity_factor != nullptr)) &&
                (!opacity_factor || opacity_factor->shape(0) == n),
            "rasterizer: opacity_factor and its gradient go together");
    require(absolute.has_value() == absgrad, "rasterizer: the absolute gradient goes with absgrad");
    return {means.data(), log_scales.data(), quats.data(), opacity_logits.data(), channels.data(),
            opacity_factor ? opacity_factor->data() : nullptr, means2d.data(), absolute ? absolute->data() : nullptr};
  }
};

void backward(Workspace& workspace, const Table& table, In<-1, -1, -1> image, In<-1, -1, -1> image_gradient,
              std::optional<In<-1, -1>> alpha_gradient, const Gradients& gradients) {
  const Splats splats = table.splats();
  const View& view = workspace.view();
  require(workspace.complete() && splats.count == view.splats.count &&
              splats.channel_count == view.splats.channel_count,
          "rasterizer: backward needs the table of the last forward pass");
  const auto fits = [&](const auto& array) {
    return is_image(array, view.camera) && array.shape(0) == table.channels.shape(1);
  };
  require(fits(image) && fits(image_gradient) && (!alpha_gradient || is_image(*alpha_gradient, view.camera)),
          "rasterizer: image and its gradient must be [C H W], the gradient of alpha [H W]");
  const SplatGradients to = gradients.pointers(splats, view.settings.absgrad);
  const nb::gil_scoped_release unlocked;
  workspace.backward(
      splats, {image.data(), image_gradient.data(), alpha_gradient ? alpha_gradient->data() : nullptr, nullptr, 0}, to);
}

void backward_of_tiles(Workspace& workspace, const Table& table, In<-1, -1, LANES> tiles, In<-1, -1, LANES> found,
                       Tensor<const std::int32_t, -1> drawn, const Gradients& gradients) {
  const Splats splats = table.splats();
  const View& view = workspace.view();
  require(workspace.complete() && splats.count == view.splats.count &&
              splats.channel_count == view.splats.channel_count,
          "rasterizer: backward needs the table of the last forward pass");
  const std::size_t blocks = tile_pixels(view.camera) / LANES, channels = table.channels.shape(1);
  const std::size_t with_gradient = found.shape(1) - 1;
  require(tiles.shape(1) == channels + 1 && tiles.shape(0) == blocks && found.shape(0) == blocks &&
              RECORD_CHANNELS < with_gradient && with_gradient <= channels && drawn.shape(0) == blocks,
          "rasterizer: tiles, their gradients and drawn are of other shapes than those of the last forward pass");
  const SplatGradients to = gradients.pointers(splats, view.settings.absgrad);
  const nb::gil_scoped_release unlocked;
  workspace.backward(splats, {tiles.data(), found.data(), nullptr, drawn.data(), static_cast<int>(with_gradient)}, to);
}

std::pair<std::uint64_t, std::uint64_t> pairs(const Workspace& workspace) {
  require(workspace.complete(), "rasterizer: there is no forward pass whose pairs could be counted");
  const nb::gil_scoped_release unlocked;
  const PairCounts counts = count_pairs(workspace.view());
  return {counts.evaluated, counts.blended};
}

nb::dict stage_seconds(const Workspace& workspace) {
  constexpr const char* NAMES[STAGES] = {"project", "sort", "bin", "blend", "blend_gradient", "project_gradient"};
  nb::dict seconds;
  for (int i = 0; i < STAGES; i++) seconds[NAMES[i]] = workspace.seconds(static_cast<Stage>(i));
  return seconds;
}

}  // namespace

void bind_raster(nb::module_& module) {
  // A way back that is alive when Python exits holds a workspace: no leak of ours.
  nb::set_leak_warnings(false);

  module.attr("BLOCK_PIXELS") = LANES;

  nb::class_<RasterSettings>(module, "RasterSettings", "What rasterize.RasterOptions says.")
      .def(nb::new_(&settings_from), nb::kw_only(), "eps2d"_a, "near"_a, "max_alpha"_a, "antialiased"_a,
           "absgrad"_a);

  nb::class_<LazyColors>(module, "LazyColors",
                         "Better colours than the channels, worked out when the blend first needs them.");

  nb::class_<Table>(module, "SplatTable",
                    "The table in stored form, channels and background; made anew for each call, unless nobody sets "
                    ".data or resizes an array in between.")
      .def(nb::init<In<-1, 3>, In<-1, 3>, In<-1, 4>, In<-1>, std::optional<In<-1>>, In<-1, -1>, In<-1>>(),
           "means"_a, "log_scales"_a, "quats"_a, "opacity_logits"_a, "opacity_factor"_a.none(), "channels"_a,
           "background"_a);

  nb::class_<Gradients>(module, "SplatGradients", "Arrays for the gradients of a SplatTable and of its footprints.")
      .def(nb::init<Out<-1, 3>, Out<-1, 3>, Out<-1, 4>, Out<-1>, std::optional<Out<-1>>, Out<-1, -1>,
                    Out<-1, 2>, std::optional<Out<-1, 2>>>(),
           "means"_a, "log_scales"_a, "quats"_a, "opacity_logits"_a, "opacity_factor"_a.none(), "channels"_a,
           "means2d"_a, "absolute"_a.none());

  nb::class_<PictureShader>(module, "PictureShader", "Turns what was blended into colour, tile by tile.");

  nb::class_<Workspace>(module, "Workspace", "What a forward pass leaves for its backward pass; reusable.")
      .def(nb::init<>())
      .def_prop_ro("stage_seconds", &stage_seconds, "How long each stage took the last time, by name.")
      .def("forward", &forward, "table"_a, "camera"_a, "settings"_a, "image"_a, "alpha"_a, "means2d"_a, "radii"_a,
           "lazy"_a = nb::none(), "shader"_a = nb::none(), "blended"_a = nb::none(), "tiles"_a = nb::none(),
           "early_stop"_a = false,
           "Fill image [C H W], alpha [H W], means2d [N 2] and radii [N 2]. Lazy colours take the place of the table's "
           "channels where these can be seen; there is no backward pass unless they are kept. A shader makes colours "
           "of what was blended, the image is [3 H W], and there is no backward pass unless blended [C H W], or tiles "
           "[blocks C + 1 16], is there to keep what the shader was given: block by block, alpha last, and channels "
           "only of blocks in which there is anything. With early_stop the last 1/64 of a pixel's light may be what "
           "lies in front of it, with alpha 1, and there is no backward pass.")
      .def("backward", &backward, "table"_a, "image"_a, "image_gradient"_a, "alpha_gradient"_a.none(), "gradients"_a,
           "Fill the gradients of the last forward pass.")
      .def("backward_of_tiles", &backward_of_tiles, "table"_a, "tiles"_a, "tile_gradients"_a, "drawn"_a, "gradients"_a,
           "The same where tiles were kept, from the gradients of their first channels and, last, of alpha; drawn "
           "[blocks] is 0 where a block has none but those of the first three channels.")
      .def("count_pairs", &pairs, "Pairs of Gaussian and pixel that the last forward pass evaluated and blended.");
}

}  // namespace ringlight
