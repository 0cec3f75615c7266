#include <nanobind/stl/vector.h>

#include <algorithm>
#include <vector>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "bindings/picture_shader.hpp"
#include "machine/buffer.hpp"
#include "raster/raster.hpp"
#include "reflection/reflection.hpp"
#include "simd/dispatch.hpp"

namespace ringlight {
namespace {

bool within(int value, int least, int most) { return least <= value && value <= most; }

ReflectionShape shape_from(int hidden, int layers, int latents, int shells, int features, const std::vector<int>& sides,
                           bool parallax, bool direction, bool depth_gradient, int axis_nodes) {
  using namespace convention;
  ReflectionShape shape{};
  shape.hidden = hidden, shape.layers = layers, shape.latents = latents, shape.shells = shells;
  shape.features = features, shape.axis_nodes = axis_nodes;
  shape.parallax = parallax, shape.direction = direction, shape.depth_gradient = depth_gradient;
  require(within(hidden, 1, REFLECTION_MAX_HIDDEN), "reflection: hidden out of range");
  require(within(layers, 2, REFLECTION_MAX_LAYERS), "reflection: layers out of range");
  require(within(latents, 0, REFLECTION_MAX_LATENTS), "reflection: latents out of range");
  require(within(shells, 1, REFLECTION_MAX_SHELLS), "reflection: shells out of range");
  require(within(features, REFLECTION_QUAD, REFLECTION_MAX_FEATURES) && features % REFLECTION_QUAD == 0,
          "reflection: features must come in fours");
  require(axis_nodes == 0 || within(axis_nodes, 2, REFLECTION_MAX_SIDE), "reflection: nodes of the axes out of range");
  require(reads_depth(shape) || !depth_gradient, "reflection: without spheres and axes depth has no gradient");
  require(!sides.empty() && sides.size() <= REFLECTION_MAX_LEVELS, "reflection: number of levels out of range");
  for (const int side : sides) {
    require(within(side, 2, REFLECTION_MAX_SIDE), "reflection: a side is out of range");
    shape.sides[shape.levels++] = side;
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

// Lengths in half of the longest side of the box, from its middle; in doubles, as Python counts.
ReflectionView view_from(const Camera& camera, const Tensor<const float, 2, 3>& box,
                         const Tensor<const float, 3>& background, float faintest, float shortest_normal,
                         float smallest_chord) {
  ReflectionView view{};
  view.camera = camera;
  const float *low = box.data(), *high = low + 3;
  double side[3];
  for (int axis = 0; axis < 3; axis++) side[axis] = static_cast<double>(high[axis]) - low[axis];
  const double scale = 2 / *std::max_element(side, side + 3);
  for (int axis = 0; axis < 3; axis++) {
    const double middle = 0.5 * (static_cast<double>(low[axis]) + high[axis]);
    view.origin[axis] = static_cast<float>((camera.position[axis] - middle) * scale);
  }
  view.scale = static_cast<float>(scale);
  std::copy_n(background.data(), 3, view.background);
  view.faintest = faintest, view.shortest_normal = shortest_normal, view.smallest_chord = smallest_chord;
  return view;
}

template <class Image>
void require_picture(const ReflectionView& view, const Image& image) {
  const Camera& camera = view.camera;
  require(std::max(image.shape(1), image.shape(2)) <= convention::MAX_IMAGE_SIDE, "reflection: the image is too large");
  require(image.shape(1) == static_cast<std::size_t>(camera.height) &&
              image.shape(2) == static_cast<std::size_t>(camera.width),
          "reflection: the image is not of the camera's size");
}

// rgb [3 H W], normal [3 H W], latents [L H W], alpha [1 H W], and depth [1 H W] unless it is not needed.
ReflectionBuffers<const float> buffers_from(const ReflectionShape& shape, const ReflectionView& view,
                                            const std::vector<Input>& planes) {
  const bool with_depth = reads_depth(shape);
  require(planes.size() == (with_depth ? 5u : 4u), "reflection: buffers are rgb, normal, latents, alpha and depth");
  const std::size_t pixels = static_cast<std::size_t>(view.camera.height) * view.camera.width;
  const std::size_t channels[] = {3, 3, static_cast<std::size_t>(shape.latents), 1, 1};
  for (std::size_t i = 0; i < planes.size(); i++)
    require(planes[i].size() == channels[i] * pixels, "reflection: a buffer has the wrong size");
  return {planes[0].data(), planes[1].data(), planes[2].data(), with_depth ? planes[4].data() : nullptr,
          planes[3].data(), pixels};
}

using Image = Tensor<float, 3, -1, -1>;
using ImageInput = Tensor<const float, 3, -1, -1>;

void forward(const ReflectionShape& shape, const std::vector<Input>& parameters, const ReflectionView& view,
             const std::vector<Input>& planes, Image color) {
  require_picture(view, color);
  const auto weights = parameters_from<const float>(shape, parameters);
  const auto buffers = buffers_from(shape, view, planes);
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN_WITH_BF16(reflection_forward)(shape, weights, view, buffers, color.data());
}

// Block by block, [blocks channels + 1 16]: rgb, normal, latents, depth unless it is not there, and alpha.
template <class Float>
ReflectionBuffers<Float> tiles_from(const ReflectionShape& shape, const ReflectionView& view,
                                    const Tensor<Float, -1, -1, LANES>& tiles, bool with_depth) {
  const std::size_t channels = 6 + static_cast<std::size_t>(shape.latents) + with_depth;
  require(tiles.shape(1) == channels + 1 && tiles.shape(0) == tile_pixels(view.camera) / LANES,
          "reflection: tiles are of another shape, or of another camera");
  const auto from = [&](std::size_t channel) { return tiles.data() + channel * LANES; };
  return {from(0), from(3), from(6), with_depth ? from(channels - 1) : nullptr, from(channels), LANES,
          (channels + 1) * LANES};
}

void backward(const ReflectionShape& shape, const std::vector<Input>& parameters, const ReflectionView& view,
              const Tensor<const float, -1, -1, LANES>& tiles, ImageInput color_gradient, double share,
              const std::vector<Array>& gradients, const Tensor<float, -1, -1, LANES>& tile_gradients,
              const Tensor<std::int32_t, -1>& drawn) {
  require(share > 0, "reflection: share must be above 0");
  require_picture(view, color_gradient);
  const auto weights = parameters_from<const float>(shape, parameters);
  const auto sums = parameters_from<float>(shape, gradients);
  const auto buffers = tiles_from<const float>(shape, view, tiles, reads_depth(shape));
  const auto to = tiles_from<float>(shape, view, tile_gradients, shape.depth_gradient);
  require(drawn.shape(0) == tiles.shape(0), "reflection: drawn needs one number for each block");
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN_WITH_BF16(reflection_backward)
  (shape, weights, view, buffers, color_gradient.data(), share, sums, to, drawn.data());
}

// Keeps parameters, which must not be given other memory meanwhile.
class ReflectionPicture : public PictureShader {
 public:
  ReflectionPicture(const ReflectionShape& shape, const std::vector<Input>& parameters, const ReflectionView& view,
                    bool exact)
      : parameters_(parameters) {
    shading_.shape = shape;
    shading_.parameters = parameters_from<const float>(shading_.shape, parameters_);
    shading_.view = view;
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
  nb::class_<ReflectionShape>(module, "ReflectionShape",
                              "Sizes of a reflection shader; axis_nodes 0: no factors of the reflecting point.")
      .def(nb::new_(&shape_from), nb::kw_only(), "hidden"_a, "layers"_a, "latents"_a, "shells"_a, "features"_a,
           "sides"_a, "parallax"_a, "direction"_a, "depth_gradient"_a, "axis_nodes"_a);
  nb::class_<ReflectionView>(module, "ReflectionView",
                             "From where, in which box, over what, and the bounds that shade/ explains.")
      .def(nb::new_(&view_from), nb::kw_only(), "camera"_a, "box"_a, "background"_a, "faintest"_a, "shortest_normal"_a,
           "smallest_chord"_a);
  module.def("reflection_forward", &forward, "shape"_a, "parameters"_a, "view"_a, "planes"_a, "color"_a,
             "Shades the pixels that are opaque enough; the others keep their rgb.");
  module.def("reflection_backward", &backward, "shape"_a, "parameters"_a, "view"_a, "tiles"_a, "color_gradient"_a,
             "share"_a, "gradients"_a, "tile_gradients"_a, "drawn"_a,
             "Gradients of all parameters and of what was kept block by block; by a share of the pixels, "
             "importance-sampled. drawn [blocks] are bits of those pixels; blocks without any get no gradients but "
             "those of rgb.");
  nb::class_<ReflectionPicture, PictureShader>(module, "ReflectionPicture",
                                               "Shades tiles of a picture as reflection_forward shades its planes; "
                                               "where exact with the same bits, else with a layer in bytes.")
      .def(nb::init<const ReflectionShape&, const std::vector<Input>&, const ReflectionView&, bool>(),
           "shape"_a, "parameters"_a, "view"_a, "exact"_a = false);
}

}  // namespace ringlight
