#include <nanobind/stl/pair.h>

#include <algorithm>
#include <utility>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "raster/raster.hpp"

namespace ringlight {
namespace {

using Pair = std::pair<float, float>;

// Takes any numbers: who draws with it refuses what cannot be drawn.
Camera camera_from(const Tensor<const float, 4, 4>& world_to_camera, const Tensor<const float, 3>& position, Pair focal,
                   Pair center, int width, int height) {
  Camera camera{{}, {}, focal.first, focal.second, center.first, center.second, width, height};
  std::copy_n(world_to_camera.data(), 12, camera.world_to_camera);
  std::copy_n(position.data(), 3, camera.position);
  return camera;
}

}  // namespace

void bind_camera(nb::module_& module) {
  nb::class_<Camera>(module, "Camera", "core.camera.Camera for the kernels; lengths on the image in pixels.")
      .def(nb::new_(&camera_from), nb::kw_only(), "world_to_camera"_a, "position"_a, "focal"_a, "center"_a, "width"_a,
           "height"_a)
      .def_prop_ro("tile_pixels", &tile_pixels, "Pixels of all tiles, those beyond the image as well.");
}

}  // namespace ringlight
