#include <nanobind/stl/pair.h>

#include <algorithm>
#include <utility>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "raster/camera.hpp"

namespace nb = nanobind;

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
  module.attr("MAX_IMAGE_SIDE") = MAX_IMAGE_SIDE;
  nb::class_<Camera>(module, "Camera", "core.camera.Camera for the kernels; lengths on the image in pixels.")
      .def("__init__", [](Camera* self, const Tensor<const float, 4, 4>& world_to_camera,
                          const Tensor<const float, 3>& position, Pair focal, Pair center, int width, int height) {
        new (self) Camera(camera_from(world_to_camera, position, focal, center, width, height));
      }, nb::kw_only(), nb::arg("world_to_camera"), nb::arg("position"), nb::arg("focal"), nb::arg("center"),
         nb::arg("width"), nb::arg("height"));
}

}  // namespace ringlight
