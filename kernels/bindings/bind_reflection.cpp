#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include <optional>
#include <vector>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "bindings/picture_shader.hpp"
#include "machine/buffer.hpp"
#include "reflection/reflection.hpp"
#include "simd/dispatch.hpp"

namespace nb = nanobind;

namespace ringlight {
namespace {

bool within(int value, int least, int most) { return least <= value && value <= most; }

ReflectionShape shape_from(const std::vector<int>& sizes) {
  constexpr std::size_t FIXED = 9;
  require(sizes.size() > FIXED && sizes.size() <= FIXED + REFLECTION_MAX_LEVELS,
          "reflection: a shape is hidden, layers, latents, shells, features, parallax, direction, depth_gradient, "
          "axis_nodes, sides");
  ReflectionShape shape{};
  shape.hidden = sizes[0], shape.layers = sizes[1];
  shape.latents = sizes[2], shape.shells = sizes[3], shape.features = sizes[4];
  shape.parallax = sizes[5] != 0, shape.direction = sizes[6] != 0, shape.depth_gradient = sizes[7] != 0;
  require(within(shape.hidden, 1, REFLECTION_MAX_HIDDEN), "reflection: hidden out of range");
  require(within(shape.layers, 2, REFLECTION_MAX_LAYERS), "reflection: layers out of range");
  require(within(shape.latents, 0, REFLECTION_MAX_LATENTS), "reflection: latents out of range");
  require(within(shape.shells, 1, REFLECTION_MAX_SHELLS), "reflection: shells out of range");
  require(within(shape.features, REFLECTION_QUAD, REFLECTION_MAX_FEATURES) && shape.features % REFLECTION_QUAD == 0,
          "reflection: features must come in fours");
  shape.axis_nodes = sizes[8];
  require(shape.axis_nodes == 0 || within(shape.axis_nodes, 2, REFLECTION_MAX_SIDE),
          "reflection: nodes of the axes out of range");
  require(reads_depth(shape) || !shape.depth_gradient, "reflection: without spheres and axes depth has no gradient");
  for (std::size_t i = FIXED; i < sizes.size(); i++) {
    require(within(sizes[i], 2, REFLECTION_MAX_SIDE), "reflection: a side is out of range");
    shape.sides[shape.levels++] = sizes[i];
  }
  return shape;
}

// The levels of each shell, the spheres and the axes if there are any, then weight and bias of each layer.
template <class Float, class Arrays>
ReflectionParameters<Float> parameters_from(const ReflectionShape& shape, const Arrays& arrays) {
  const std::size_t count = static_cast<std::size_t>(shape.shells) * shape.levels + shape.parallax +
                            (shape.axis_nodes > 0) + 2 * shape.layers;
  require(arrays.size() == count, "reflection: wrong number of parameters");
  std::size_t next = 0;
  const auto take = [&](std::size_t size) -> Float* {
    require(arrays[next].size() == size, "reflection: a parameter has the wrong size");
    return arrays[next++].data();
  };
  ReflectionParameters<Float> parameters{};
  for (int shell = 0; shell < shape.shells; shell++)
    for (int level = 0; level < shape.levels; level++) parameters.maps[shell][level] = take(level_size(shape, level));
  if (shape.parallax) parameters.sphere = take(4 * static_cast<std::size_t>(shape.shells));
  if (shape.axis_nodes) parameters.axes = take(axes_size(shape));
  std::size_t inputs = network_inputs(shape);
  for (int layer = 0; layer < shape.layers; layer++) {
    const std::size_t outputs = layer + 1 < shape.layers ? shape.hidden : 3;
    parameters.mlp[layer].weight = take(inputs * outputs);
    parameters.mlp[layer].bias = take(outputs);
    inputs = outputs;
  }
  return parameters;
}

ReflectionView view_from(const std::vector<float>& numbers, std::size_t height, std::size_t width) {
  constexpr std::size_t MOST_SIDE = 1 << 13;  // MAX_IMAGE_SIDE: a pixel's number fits 32 bits
  require(height <= MOST_SIDE && width <= MOST_SIDE, "reflection: the image is too large");
  require(numbers.size() == 23,
          "reflection: a view is rotation, focal, center, origin, scale, background, three bounds");
  ReflectionView view{};
  view.height = static_cast<int>(height), view.width = static_cast<int>(width);
  const float* from = numbers.data();
  for (float& number : view.rotation) number = *from++;
  for (float& number : view.focal) number = *from++;
  for (float& number : view.center) number = *from++;
  for (float& number : view.origin) number = *from++;
  view.scale = *from++;
  for (float& number : view.background) number = *from++;
  view.faintest = from[0], view.shortest_normal = from[1], view.smallest_chord = from[2];
  return view;
}

// rgb [3 H W], normal [3 H W], latents [L H W], alpha [1 H W], and depth [1 H W] unless it is not needed.
template <class Float, class Array>
ReflectionBuffers<Float> buffers_from(const ReflectionShape& shape, const ReflectionView& view,
                                      const std::vector<Array>& planes, bool with_depth) {
  require(planes.size() == (with_depth ? 5u : 4u), "reflection: buffers are rgb, normal, latents, alpha and depth");
  const std::size_t pixels = static_cast<std::size_t>(view.height) * view.width;
  const std::size_t channels[] = {3, 3, static_cast<std::size_t>(shape.latents), 1, 1};
  for (std::size_t i = 0; i < planes.size(); i++)
    require(planes[i].size() == channels[i] * pixels, "reflection: a buffer has the wrong size");
  return {planes[0].data(), planes[1].data(), planes[2].data(), with_depth ? planes[4].data() : nullptr,
          planes[3].data(), pixels};
}

using Image = Tensor<float, 3, -1, -1>;
using ImageInput = Tensor<const float, 3, -1, -1>;

void forward(const std::vector<int>& sizes, const std::vector<Input>& parameters, const std::vector<float>& numbers,
             const std::vector<Input>& planes, Image color) {
  const ReflectionShape shape = shape_from(sizes);
  const auto weights = parameters_from<const float>(shape, parameters);
  const ReflectionView view = view_from(numbers, color.shape(1), color.shape(2));
  const auto buffers = buffers_from<const float>(shape, view, planes, reads_depth(shape));
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN_WITH_BF16(reflection_forward)(shape, weights, view, buffers, color.data());
}

void backward(const std::vector<int>& sizes, const std::vector<Input>& parameters, const std::vector<float>& numbers,
              const std::vector<Input>& planes, ImageInput color_gradient, double share,
              const std::vector<Array>& gradients, const std::vector<Array>& plane_gradients) {
  require(share > 0, "reflection: share must be above 0");
  const ReflectionShape shape = shape_from(sizes);
  const auto weights = parameters_from<const float>(shape, parameters);
  const auto sums = parameters_from<float>(shape, gradients);
  const ReflectionView view = view_from(numbers, color_gradient.shape(1), color_gradient.shape(2));
  const auto buffers = buffers_from<const float>(shape, view, planes, reads_depth(shape));
  const auto to = buffers_from<float>(shape, view, plane_gradients, shape.depth_gradient);
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN_WITH_BF16(reflection_backward)
  (shape, weights, view, buffers, color_gradient.data(), share, sums, to);
}

// Keeps parameters, which must not be given other memory meanwhile.
class ReflectionPicture : public PictureShader {
 public:
  ReflectionPicture(const std::vector<int>& sizes, const std::vector<Input>& parameters,
                    const std::vector<float>& numbers, bool exact)
      : parameters_(parameters) {
    shading_.shape = shape_from(sizes);
    shading_.parameters = parameters_from<const float>(shading_.shape, parameters_);
    shading_.view = view_from(numbers, 0, 0);
    shading_.exact = exact;
    char* const room = room_.reserve(RINGLIGHT_CHOSEN_WITH_BF16(reflection_room)(shading_));
    RINGLIGHT_CHOSEN_WITH_BF16(reflection_prepare)(shading_, room);
  }

  const TileShader& shader() const override { return shading_; }
  std::size_t channels() const override { return static_cast<std::size_t>(shaded_channels(shading_.shape)); }

 private:
  std::vector<Input> parameters_;
  ReflectionShading shading_{};
  Buffer<char> room_;
};

}  // namespace

void bind_reflection(nb::module_& module) {
  module.def("reflection_forward", &forward, nb::arg("shape"), nb::arg("parameters"), nb::arg("view"),
             nb::arg("planes"), nb::arg("color"),
             "Shades the pixels that are opaque enough; the others keep their rgb.");
  module.def("reflection_backward", &backward, nb::arg("shape"), nb::arg("parameters"), nb::arg("view"),
             nb::arg("planes"), nb::arg("color_gradient"), nb::arg("share"), nb::arg("gradients"),
             nb::arg("plane_gradients"),
             "Gradients of all parameters and of the planes; by a share of the pixels, drawn by lot.");
  nb::class_<ReflectionPicture, PictureShader>(module, "ReflectionPicture",
                                               "Shades tiles of a picture as reflection_forward shades its planes; "
                                               "where exact with the same bits, else with a layer in bytes.")
      .def(nb::init<const std::vector<int>&, const std::vector<Input>&, const std::vector<float>&, bool>(),
           nb::arg("shape"), nb::arg("parameters"), nb::arg("view"), nb::arg("exact") = false);
}

}  // namespace ringlight
