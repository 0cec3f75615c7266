#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <optional>
#include <tuple>
#include <vector>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "reflection/mirror_channels.hpp"
#include "simd/dispatch.hpp"
#include "step/sh.hpp"

namespace ringlight {
namespace {

using Rows = Tensor<const float, -1, -1>;
using Points = Tensor<const float, -1, 3>;
using Varying = std::tuple<Points, Input, Tensor<float, -1, 3>>;

MirrorScene scene_from(const MirrorView& view, std::size_t count, std::size_t latents) {
  require(latents <= convention::MIRROR_MAX_LATENTS, "mirror_channels: too many latents");
  return {view, count, static_cast<int>(latents), {nullptr, nullptr, nullptr}};
}

template <class Float, class Array>
MirrorColumns<Float> columns_from(const MirrorScene& scene, const std::vector<Array>& columns) {
  require(columns.size() == 4, "mirror_channels: columns are means, base, normals and latents");
  for (int i = 0; i < 4; i++)
    require(columns[i].size() == scene.count * (i < 3 ? 3u : static_cast<std::size_t>(scene.latents)),
            "mirror_channels: a column has the wrong size");
  return {columns[0].data(), columns[1].data(), columns[2].data(), columns[3].data()};
}

void forward(const MirrorView& view, const std::vector<Input>& columns, Tensor<float, -1, -1> channels,
             const std::optional<Points>& colors) {
  require(channels.shape(1) >= 7, "mirror_channels: channels must be [N 7 + L]");
  MirrorScene scene = scene_from(view, channels.shape(0), channels.shape(1) - 7);
  require(!colors || colors->shape(0) == scene.count, "mirror_channels: colors must be [N 3]");
  if (colors) scene.varying.colors = colors->data();
  const auto from = columns_from<const float>(scene, columns);
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(mirror_channels)(scene, from, channels.data());
}

bool backward(const MirrorView& view, const std::vector<Input>& columns, Rows upstream,
              const std::vector<Array>& gradients, const std::optional<Varying>& varying) {
  require(upstream.shape(1) >= 7, "mirror_channels: channels must be [N 7 + L]");
  MirrorScene scene = scene_from(view, upstream.shape(0), upstream.shape(1) - 7);
  if (varying) {
    const auto& [colors, slopes, by_constant] = *varying;
    const std::size_t blocks = (scene.count + 15) / 16;
    require(colors.shape(0) == scene.count && by_constant.shape(0) == scene.count,
            "mirror_gradient: colors and their gradient must be [N 3]");
    require(slopes.size() >= blocks * 16 * SH_SLOPES, "mirror_gradient: slopes must hold sh_slopes(rows) floats");
    scene.varying = {colors.data(), slopes.data(), by_constant.data()};
  }
  const auto from = columns_from<const float>(scene, columns);
  const auto to = columns_from<float>(scene, gradients);
  const nb::gil_scoped_release unlocked;
  return RINGLIGHT_CHOSEN(mirror_gradient)(scene, from, upstream.data(), to);
}

}  // namespace

void bind_mirror(nb::module_& module) {
  nb::class_<MirrorView>(module, "MirrorView", "From where, and the bounds of normals that color/mirror.py explains.")
      .def(nb::init<Camera, float, float>(), nb::kw_only(), "camera"_a, "flip_below"_a, "smallest_length"_a);
  module.def("mirror_channels", &forward, "view"_a, "columns"_a, "channels"_a, "colors"_a.none() = nb::none(),
             "Base colour, unit normal, latents and depth of each Gaussian, side by side; `colors` [N 3], which "
             "sh_basis_colors made of the base, in its place.");
  module.def("mirror_gradient", &backward, "view"_a, "columns"_a, "upstream"_a, "gradients"_a,
             "varying"_a.none() = nb::none(),
             "Gradients of the columns; returns whether positions have one. `varying` are colors and slopes as "
             "sh_basis_colors left them, and what to fill for sh_basis_gradient.");
}

}  // namespace ringlight
