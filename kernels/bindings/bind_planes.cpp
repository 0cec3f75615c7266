#include "bindings/bindings.hpp"
#include "bindings/plane_inputs.hpp"
#include "simd/dispatch.hpp"

namespace ringlight {
namespace {

using Points = Tensor<const float, -1, 3>;
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
