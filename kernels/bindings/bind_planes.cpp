#include <nanobind/stl/vector.h>

#include <vector>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "convention.hpp"
#include "planes/planes.hpp"

namespace ringlight {
namespace {

using Points = Tensor<const float, -1, 3>;
template <class Float>
using Planes = std::vector<Tensor<Float, -1, -1, -1>>;
template <class Float>
using Lines = std::vector<Tensor<Float, -1, -1>>;

template <class Float>
PlaneShape shape_of(const Planes<Float>& planes, const Lines<Float>& lines) {
  require(planes.size() == PLANE_PAIRS && lines.size() == PLANE_PAIRS,
          "planes: there are three planes and three lines");
  const std::size_t channels = planes[0].shape(2);
  require(channels >= 1 && channels <= convention::PLANES_MAX_CHANNELS, "planes: give 1 to 1024 channels");
  const auto nodes = [](std::size_t count) {
    require(count >= 2 && count <= convention::PLANES_MAX_SIDE, "planes: an axis has 2 to 4096 nodes");
    return static_cast<int>(count);
  };
  PlaneShape shape{static_cast<int>(channels), {}};
  for (int pair = 0; pair < PLANE_PAIRS; pair++) {
    require(planes[pair].shape(2) == channels && lines[pair].shape(1) == channels,
            "planes: planes [down across C] and lines [along C] must have the same channels");
    shape.pairs[pair] = {nodes(planes[pair].shape(1)), nodes(planes[pair].shape(0)), nodes(lines[pair].shape(0))};
  }
  return shape;
}

template <class Float>
PlaneGrids<Float> grids_of(const Planes<Float>& planes, const Lines<Float>& lines) {
  PlaneGrids<Float> grids;
  for (int pair = 0; pair < PLANE_PAIRS; pair++) {
    grids.planes[pair] = planes[pair].data();
    grids.lines[pair] = lines[pair].data();
  }
  return grids;
}

bool same(const PlaneShape& a, const PlaneShape& b) {
  bool equal = a.channels == b.channels;
  for (int pair = 0; pair < PLANE_PAIRS; pair++) {
    const PairSize &one = a.pairs[pair], &other = b.pairs[pair];
    equal = equal && one.across == other.across && one.down == other.down && one.along == other.along;
  }
  return equal;
}

void products(Points points, const Planes<const float>& planes, const Lines<const float>& lines, Array result) {
  const PlaneShape shape = shape_of(planes, lines);
  const auto grids = grids_of(planes, lines);
  const std::size_t count = points.shape(0);
  require(result.size() == count * PLANE_PAIRS * shape.channels, "planes: products must be [N 3C]");
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(plane_products)(shape, grids, count, points.data(), result.data());
}

void gradient(Points points, const Planes<const float>& planes, const Lines<const float>& lines, Input upstream,
              const Planes<float>& of_planes, const Lines<float>& of_lines) {
  const PlaneShape shape = shape_of(planes, lines);
  require(same(shape, shape_of(of_planes, of_lines)), "planes: gradients must have their grids' sizes");
  const auto grids = grids_of(planes, lines);
  const auto gradients = grids_of(of_planes, of_lines);
  const std::size_t count = points.shape(0);
  require(upstream.size() == count * PLANE_PAIRS * shape.channels, "planes: the gradient of products must be [N 3C]");
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(plane_gradient)(shape, grids, count, points.data(), upstream.data(), gradients);
}

}  // namespace

void bind_planes(nb::module_& module) {
  module.def("plane_products", &products, "points"_a, "planes"_a, "lines"_a, "products"_a,
             "Products [N 3C] of planes [down across C] and lines [along C] at points [N 3] in [-1, 1]^3.");
  module.def("plane_gradient", &gradient, "points"_a, "planes"_a, "lines"_a, "upstream"_a, "of_planes"_a,
             "of_lines"_a, "Gradients of planes and lines from that of products [N 3C].");
}

}  // namespace ringlight
