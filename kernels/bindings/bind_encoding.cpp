#include <nanobind/stl/optional.h>

#include <algorithm>
#include <optional>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "encoding/directional_encoding.hpp"
#include "encoding/tanh_rows.hpp"

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

void tanh_of_rows(Tensor<const float, -1, -1> values, const std::optional<Tensor<const std::int32_t, -1>>& numbers,
                  Tensor<float, -1, -1> rows, std::size_t first) {
  const std::size_t count = rows.shape(0), stride = rows.shape(1), width = values.shape(1), known = values.shape(0);
  require((numbers ? numbers->shape(0) : known) == count, "tanh_rows: chosen and written rows must be as many");
  require(width <= stride && first <= stride - width, "tanh_rows: values must fit a row from its first one on");
  require(!numbers || std::all_of(numbers->data(), numbers->data() + count,
                                  [=](std::int32_t n) { return n >= 0 && static_cast<std::size_t>(n) < known; }),
          "tanh_rows: a row is not one of the values'");
  if (count == 0 || width == 0) return;
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(tanh_rows)
  (count, width, values.data(), numbers ? numbers->data() : nullptr, stride, rows.data() + first);
}

}  // namespace

void bind_encoding(nb::module_& module) {
  module.def("directional_encoding", &encode, "directions"_a, "roughness"_a, "polynomials"_a, "rows"_a, "first"_a,
             "Integrated directional encoding of unit directions [N 3] to columns first .. first + 37 of rows [N W].");
  module.def("tanh_rows", &tanh_of_rows, "values"_a, "numbers"_a.none(), "rows"_a, "first"_a,
             "Hyperbolic tangents of numbered rows of values [M C], or all, to columns from first on of rows [N W].");
}

}  // namespace ringlight
