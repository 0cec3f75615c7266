#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "machine/buffer.hpp"
#include "raster/raster.hpp"
#include "ring/ring.hpp"
#include "simd/dispatch.hpp"

namespace ringlight {
namespace {

using Rows = Tensor<const std::int32_t, -1>;
using Box = Tensor<const float, 2, 3>;

RingShape shape_from(int rank, int features, int render_hidden, int modulation_hidden, int nodes, int view_nodes,
                     int latents, bool diagonal, bool factor, bool clamped) {
  using namespace convention;
  require(rank >= 1 && rank <= RING_MAX_RANK, "ring: rank out of range");
  require(features >= 1 && features <= RING_MAX_FEATURES, "ring: features out of range");
  require(render_hidden >= 1 && render_hidden <= RING_MAX_HIDDEN, "ring: render_hidden out of range");
  require(modulation_hidden >= 0 && modulation_hidden <= RING_MAX_HIDDEN, "ring: modulation_hidden out of range");
  require(nodes >= 2 && nodes <= RING_MAX_NODES && view_nodes >= 2 && view_nodes <= RING_MAX_NODES,
          "ring: nodes out of range");
  require(latents >= 0 && latents <= RING_MAX_LATENTS, "ring: latents out of range");
  return {rank, features, render_hidden, modulation_hidden, nodes, view_nodes, latents, diagonal, factor,
          clamped};
}

std::vector<std::size_t> parameter_sizes(const RingShape& shape) {
  const std::size_t hidden = shape.render_hidden;
  std::vector<std::size_t> sizes{3 * axis_size(shape), view_size(shape), shape.features * matrix_size(shape)};
  const auto layer = [&](std::size_t outputs, std::size_t inputs) {
    sizes.push_back(outputs * inputs);
    sizes.push_back(outputs);
  };
  if (modulated(shape)) {
    layer(shape.modulation_hidden, modulation_inputs(shape));
    layer(1, shape.modulation_hidden);
  }
  layer(hidden, render_inputs(shape));
  layer(hidden, hidden);
  layer(3, hidden);
  return sizes;
}

// axes, view, core, then weight and bias of each layer: modulation (unless without), render.
template <class Float, class Arrays>
RingParameters<Float> parameters_from(const RingShape& shape, const Arrays& arrays) {
  const std::vector<std::size_t> sizes = parameter_sizes(shape);
  require(arrays.size() == sizes.size(), "ring: wrong number of parameters");
  for (std::size_t i = 0; i < sizes.size(); i++)
    require(arrays[i].size() == sizes[i], "ring: a parameter has the wrong size");
  RingParameters<Float> parameters{arrays[0].data(), arrays[1].data(), arrays[2].data(), {}, {}};
  std::size_t next = 3;
  const auto take = [&](RingLayer<Float>& layer) {
    layer = {arrays[next].data(), arrays[next + 1].data()};
    next += 2;
  };
  if (modulated(shape))
    for (auto& layer : parameters.modulation) take(layer);
  for (auto& layer : parameters.render) take(layer);
  return parameters;
}

// The columns of the table of Gaussians that the field reads: [N 3], [N 3], [N latents].
struct Columns {
  Input means, base, latents;
};

RingScene scene_from(const RingShape& shape, const Columns& columns, const Rows* visible, const Camera& camera,
                     const Box& box) {
  const auto& [means, base, latents] = columns;
  RingScene scene{};
  scene.means = means.data(), scene.base = base.data(), scene.latents = latents.data();
  scene.count = means.size() / 3;
  if (visible) scene.visible = visible->data(), scene.visible_count = visible->size();
  require(means.size() == 3 * scene.count && base.size() == 3 * scene.count, "ring: means and base must be [N 3]");
  require(latents.size() == shape.latents * scene.count, "ring: latents must be [N L]");
  std::copy_n(camera.position, 3, scene.camera);
  std::copy_n(box.data(), 3, scene.low);
  std::copy_n(box.data() + 3, 3, scene.high);
  for (std::size_t i = 0; i < scene.visible_count; i++)
    require(static_cast<std::size_t>(scene.visible[i]) < scene.count, "ring: a visible row is not in the table");
  return scene;
}

void forward(const RingShape& shape, const std::vector<Input>& parameters, Input means, Input base,
             Input latents, Rows visible, const Camera& camera, Box box, Array color, std::optional<Array> residual,
             std::optional<Array> modulation) {
  const auto weights = parameters_from<const float>(shape, parameters);
  const RingScene scene = scene_from(shape, {means, base, latents}, &visible, camera, box);
  require(color.size() == 3 * scene.count, "ring: color must be [N 3]");
  require(!residual || residual->size() == 3 * scene.count, "ring: residual must be [N 3]");
  require(!modulation || modulation->size() == scene.count, "ring: modulation must be [N 1]");
  const RingOutputs outputs{color.data(), residual ? residual->data() : nullptr,
                            modulation ? modulation->data() : nullptr};
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN_WITH_BF16(ring_forward)(shape, weights, scene, outputs);
}

void backward(const RingShape& shape, const std::vector<Input>& parameters, Input means, Input base,
              Input latents, Rows visible, const Camera& camera, Box box, Input color, Input color_gradient,
              double share, const std::vector<Array>& gradients, Array base_gradient, Array latents_gradient,
              Array workspace) {
  const auto weights = parameters_from<const float>(shape, parameters);
  const auto sums = parameters_from<float>(shape, gradients);
  const RingScene scene = scene_from(shape, {means, base, latents}, &visible, camera, box);
  require(share > 0, "ring: share must be above 0");
  require(color.size() == 3 * scene.count, "ring: color must be [N 3]");
  require(color_gradient.size() == 3 * scene.count && base_gradient.size() == 3 * scene.count,
          "ring: gradients of color and base must be [N 3]");
  require(latents_gradient.size() == latents.size(), "ring: the gradient of latents must be [N L]");
  require(workspace.size() >= RINGLIGHT_CHOSEN_WITH_BF16(ring_workspace)(shape, scene.visible_count),
          "ring: the workspace is too small");
  const RingRowGradients row_sums{base_gradient.data(), latents_gradient.data()};
  const RingUpstream upstream{color.data(), color_gradient.data(), share};
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN_WITH_BF16(ring_backward)(shape, weights, scene, upstream, sums, row_sums, workspace.data());
}

std::size_t workspace(const RingShape& shape, std::size_t visible_count) {
  require(visible_count <= std::numeric_limits<std::int32_t>::max(), "ring: too many rows");
  return RINGLIGHT_CHOSEN_WITH_BF16(ring_workspace)(shape, visible_count);
}

// The light field of one view, for rows that are asked for one after the other. Keeps its arrays alive.
class LazyRing : public LazyColors {
 public:
  LazyRing(const RingShape& shape, std::vector<Input> parameters, Input means, Input base, Input latents,
           const Camera& camera, const Box& box, std::optional<Array> colors)
      : LazyColors{RINGLIGHT_CHOSEN_WITH_BF16(ring_light), &ring_, 0, 0, colors ? colors->data() : nullptr},
        parameters_(std::move(parameters)), columns_{means, base, latents}, colors_(colors) {
    ring_.shape = shape;
    ring_.parameters = parameters_from<const float>(ring_.shape, parameters_);
    ring_.scene = scene_from(ring_.shape, columns_, nullptr, camera, box);
    count = ring_.scene.count;
    require(!colors || colors->size() == LAZY_CHANNELS * count, "ring: colors must be [N 3]");
    scratch = RINGLIGHT_CHOSEN_WITH_BF16(ring_light_floats)(ring_.shape);
    float* const packed = packed_.reserve(RINGLIGHT_CHOSEN_WITH_BF16(ring_packed_floats)(ring_.shape));
    RINGLIGHT_CHOSEN_WITH_BF16(ring_pack)(ring_.shape, ring_.parameters, packed);
    ring_.packed = packed;
  }
  LazyRing(const LazyRing&) = delete;
  LazyRing& operator=(const LazyRing&) = delete;

 private:
  std::vector<Input> parameters_;
  Columns columns_;
  std::optional<Array> colors_;
  Buffer<float> packed_;
  PackedRing ring_{};
};

}  // namespace

void bind_ring(nb::module_& module) {
  nb::class_<RingShape>(module, "RingShape", "Sizes of a light field; modulation_hidden 0: without light modulation.")
      .def(nb::new_(&shape_from), nb::kw_only(), "rank"_a, "features"_a, "render_hidden"_a, "modulation_hidden"_a,
           "nodes"_a, "view_nodes"_a, "latents"_a, "diagonal"_a, "factor"_a, "clamped"_a);
  module.def("ring_forward", &forward, "shape"_a, "parameters"_a, "means"_a, "base"_a, "latents"_a, "visible"_a,
             "camera"_a, "box"_a, "color"_a, "residual"_a = nb::none(), "modulation"_a = nb::none(),
             "Colours of the visible rows by the light field.");
  module.def("ring_backward", &backward, "shape"_a, "parameters"_a, "means"_a, "base"_a, "latents"_a, "visible"_a,
             "camera"_a, "box"_a, "color"_a, "color_gradient"_a, "share"_a, "gradients"_a, "base_gradient"_a,
             "latents_gradient"_a, "workspace"_a,
             "Gradients of all parameters, of the base colours' logits and of the latents; by a share of the rows, "
             "importance-sampled.");
  nb::class_<LazyRing, LazyColors>(module, "LazyRing",
                                   "The light field's colours, row by row when the blend needs them. With `colors`, "
                                   "where they are kept, a backward pass may follow.")
      .def(nb::init<const RingShape&, std::vector<Input>, Input, Input, Input, const Camera&, Box,
                    std::optional<Array>>(),
           "shape"_a, "parameters"_a, "means"_a, "base"_a, "latents"_a, "camera"_a, "box"_a, "colors"_a = nb::none());
  module.def("ring_workspace", &workspace, "shape"_a, "visible_count"_a,
             "Floats of workspace that ring_backward needs.");
}

}  // namespace ringlight
