#include <nanobind/stl/vector.h>

#include <vector>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "reflection/mirror_channels.hpp"
#include "simd/dispatch.hpp"

namespace ringlight {
namespace {

using Rows = Tensor<const float, -1, -1>;

MirrorScene scene_from(const MirrorView& view, std::size_t count, std::size_t latents) {
  require(latents <= convention::MIRROR_MAX_LATENTS, "mirror_channels: too many latents");
  return {view, count, static_cast<int>(latents)};
}

template <class Float, class Array>
MirrorColumns<Float> columns_from(const MirrorScene& scene, const std::vector<Array>& columns) {
  require(columns.size() == 4, "mirror_channels: columns are means, base, normals and latents");
  for (int i = 0; i < 4; i++)
    require(columns[i].size() == scene.count * (i < 3 ? 3u : static_cast<std::size_t>(scene.latents)),
            "mirror_channels: a column has the wrong size");
  return {columns[0].data(), columns[1].data(), columns[2].data(), columns[3].data()};
}

void forward(const MirrorView& view, const std::vector<Input>& columns, Tensor<float, -1, -1> channels) {
  require(channels.shape(1) >= 7, "mirror_channels: channels must be [N 7 + L]");
  const MirrorScene scene = scene_from(view, channels.shape(0), channels.shape(1) - 7);
  const auto from = columns_from<const float>(scene, columns);
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(mirror_channels)(scene, from, channels.data());
}

bool backward(const MirrorView& view, const std::vector<Input>& columns, Rows upstream,
              const std::vector<Array>& gradients) {
  require(upstream.shape(1) >= 7, "mirror_channels: channels must be [N 7 + L]");
  const MirrorScene scene = scene_from(view, upstream.shape(0), upstream.shape(1) - 7);
  const auto from = columns_from<const float>(scene, columns);
  const auto to = columns_from<float>(scene, gradients);
  const nb::gil_scoped_release unlocked;
  return RINGLIGHT_CHOSEN(mirror_gradient)(scene, from, upstream.data(), to);
}

}  // namespace

void bind_mirror(nb::module_& module) {
  nb::class_<MirrorView>(module, "MirrorView", "From where, and the bounds of normals that color/mirror.py explains.")
      .def(nb::init<Camera, float, float>(), nb::kw_only(), "camera"_a, "flip_below"_a, "smallest_length"_a);
  module.def("mirror_channels", &forward, "view"_a, "columns"_a, "channels"_a,
             "Base colour, unit normal, latents and depth of each Gaussian, side by side.");
  module.def("mirror_gradient", &backward, "view"_a, "columns"_a, "upstream"_a, "gradients"_a,
             "Gradients of the columns; returns whether any depth had one.");
}

}  // namespace ringlight
