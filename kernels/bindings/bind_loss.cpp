#include <nanobind/stl/optional.h>

#include <cstdint>
#include <optional>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "step/ssim.hpp"

namespace ringlight {
namespace {

using Image = Tensor<const float, -1, -1, -1>;
using Result = Tensor<float, -1, -1, -1>;
using Workspace = Tensor<float, -1>;

template <class Planar>
void require_shape(const Planar& array, const Planes& planes) {
  require(array.shape(0) == static_cast<std::size_t>(planes.channels) &&
              array.shape(1) == static_cast<std::size_t>(planes.height) &&
              array.shape(2) == static_cast<std::size_t>(planes.width),
          "photometric: all images must have the same shape [channels, height, width]");
}

Planes planes_of(const Image& image) {
  // int is enough for every side, and keeps the row arithmetic of the kernels signed.
  constexpr std::size_t LARGEST = 1 << 30;
  for (std::size_t axis = 0; axis < 3; axis++)
    require(image.shape(axis) >= 1 && image.shape(axis) <= LARGEST, "photometric: an image side is 0 or above 2^30");
  return {static_cast<int>(image.shape(0)), static_cast<int>(image.shape(1)), static_cast<int>(image.shape(2))};
}

std::size_t workspace_size(int height, int width, int slots) {
  require(height >= 1 && width >= 1 && slots >= 1,
          "photometric_workspace: height, width and slots must be positive");
  const Planes planes{1, height, width};
  return strip_scratch(planes) * static_cast<std::size_t>(slots);
}

// Results are written while rows of the images are still to be read.
void require_apart(const Image& image, const Result& result) {
  const auto begin = reinterpret_cast<std::uintptr_t>(image.data());
  const auto written = reinterpret_cast<std::uintptr_t>(result.data());
  require(begin >= written + result.nbytes() || written >= begin + image.nbytes(),
          "photometric: results may not share memory with an image");
}

double photometric_loss(Image image, Image target, Image target_blur, Image target_square_blur, Result gradient,
                        Workspace workspace, float pixel_weight, float ssim_weight, bool squared,
                        const std::optional<Array>& value) {
  const Planes planes = planes_of(image);
  for (const Image& other : {target, target_blur, target_square_blur}) require_shape(other, planes);
  require_shape(gradient, planes);
  for (const Image& input : {image, target, target_blur, target_square_blur}) require_apart(input, gradient);
  require(!value || value->size() == 1, "photometric: the value is one number");
  const nb::gil_scoped_release unlocked;
  const double loss = photometric(
      {image.data(), target.data(), target_blur.data(), target_square_blur.data(), gradient.data()}, planes,
      {pixel_weight, ssim_weight, squared}, workspace.data(), workspace.size());
  if (value) *value->data() = static_cast<float>(loss);
  return loss;
}

void blur(Image image, Result blurred, Result square_blurred, Workspace workspace) {
  const Planes planes = planes_of(image);
  require_shape(blurred, planes);
  require_shape(square_blurred, planes);
  require_apart(image, blurred);
  require_apart(image, square_blurred);
  const nb::gil_scoped_release unlocked;
  blur_target(image.data(), planes, blurred.data(), square_blurred.data(), workspace.data(), workspace.size());
}

}  // namespace

void bind_loss(nb::module_& module) {
  module.def("photometric_workspace", &workspace_size, "height"_a, "width"_a, "slots"_a,
             "Floats of workspace that let `slots` threads work on images of this size.");
  module.def("photometric", &photometric_loss, "image"_a, "target"_a, "target_blur"_a, "target_square_blur"_a,
             "gradient"_a, "workspace"_a, "pixel_weight"_a, "ssim_weight"_a, "squared"_a,
             "value"_a.none() = nb::none(),
             "pixel_weight * mean(|d| or d^2) + ssim_weight * (1 - mean SSIM) of planar float32 images; fills the "
             "gradient with respect to image and, if given, the value, which is also returned.");
  module.def("blur_target", &blur, "image"_a, "blur"_a, "square_blur"_a, "workspace"_a,
             "11 x 11 Gaussian blurs (sigma 1.5, zeros outside) of a planar image and of its square.");
}

}  // namespace ringlight
