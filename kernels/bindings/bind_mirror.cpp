#include <nanobind/stl/vector.h>

#include <vector>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "reflection/mirror_channels.hpp"
#include "simd/dispatch.hpp"

namespace nb = nanobind;

namespace ringlight {
namespace {

using Rows = Tensor<const float, -1, -1>;

MirrorScene scene_from(const std::vector<float>& view, std::size_t count, std::size_t latents) {
  require(view.size() == 9, "mirror_channels: a view is the camera's position, the depth's row, and two bounds");
  require(latents <= MIRROR_MAX_LATENTS, "mirror_channels: too many latents");
  const float* from = view.data();
  return {count, static_cast<int>(latents), {from[0], from[1], from[2]}, {from[3], from[4], from[5], from[6]}, from[7],
          from[8]};
}

template <class Float, class Array>
MirrorColumns<Float> columns_from(const MirrorScene& scene, const std::vector<Array>& columns) {
  require(columns.size() == 4, "mirror_channels: columns are means, base, normals and latents");
  for (int i = 0; i < 4; i++)
    require(columns[i].size() == scene.count * (i < 3 ? 3u : static_cast<std::size_t>(scene.latents)),
            "mirror_channels: a column has the wrong size");
  return {columns[0].data(), columns[1].data(), columns[2].data(), columns[3].data()};
}

void forward(const std::vector<float>& view, const std::vector<Input>& columns, Tensor<float, -1, -1> channels) {
  require(channels.shape(1) >= 7, "mirror_channels: channels must be [N 7 + L]");
  const MirrorScene scene = scene_from(view, channels.shape(0), channels.shape(1) - 7);
  const auto from = columns_from<const float>(scene, columns);
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(mirror_channels)(scene, from, channels.data());
}

bool backward(const std::vector<float>& view, const std::vector<Input>& columns, Rows upstream,
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
  module.def("mirror_channels", &forward, nb::arg("view"), nb::arg("columns"), nb::arg("channels"),
             "Base colour, unit normal, latents and depth of each Gaussian, side by side.");
  module.def("mirror_gradient", &backward, nb::arg("view"), nb::arg("columns"), nb::arg("upstream"),
             nb::arg("gradients"), "Gradients of the columns; returns whether any depth had one.");
}

}  // namespace ringlight
