#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "encoding/directional_encoding.hpp"
#include "simd/dispatch.hpp"

namespace ringlight {
namespace {

void encode(Tensor<const float, -1, 3> directions, Tensor<const float, -1> roughness,
            Tensor<const float, CODE_PAIRS, HIGHEST_LEVEL + 1> polynomials, Tensor<float, -1, -1> rows,
            std::size_t first) {
  const std::size_t count = directions.shape(0), stride = rows.shape(1);
  require(roughness.shape(0) == count && rows.shape(0) == count,
          "directional_encoding: directions, roughness and rows must be as many");
  require(stride >= CODE_WIDTH && first <= stride - CODE_WIDTH,
          "directional_encoding: 38 numbers must fit a row from its first one on");
  if (count == 0) return;
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(directional_encoding)
  (count, directions.data(), roughness.data(), polynomials.data(), stride, rows.data() + first);
}

}  // namespace

void bind_encoding(nb::module_& module) {
  module.def("directional_encoding", &encode, "directions"_a, "roughness"_a, "polynomials"_a, "rows"_a, "first"_a,
             "Integrated directional encoding of unit directions [N 3] to columns first .. first + 37 of rows [N W].");
}

}  // namespace ringlight
