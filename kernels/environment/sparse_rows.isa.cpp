#include "environment/sparse_rows.hpp"

#include <cstring>

#include "environment/environment.hpp"
#include "machine/parallel.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

// One texel as one register, which loops over four floats do not become by themselves.
typedef float Quad __attribute__((vector_size(TEXEL * sizeof(float))));

}  // namespace

void sparse_product(const SparseRows& rows, const float* values, float* sums) {
  constexpr std::size_t ROWS_PER_PIECE = 256;
  constexpr int CHAINS = 4;  // sums at once, so that none waits for its last addition
  parallel_ranges(rows.count, ROWS_PER_PIECE, [&](std::size_t begin, std::size_t end) {
    const auto term = [&](std::int32_t entry) {
      Quad from;
      std::memcpy(&from, values + TEXEL * static_cast<std::size_t>(rows.sources[entry]), sizeof from);
      return rows.weights[entry] * from;
    };
    for (std::size_t row = begin; row < end; row++) {
      Quad a{}, b{}, c{}, d{};
      const std::int32_t last = rows.starts[row + 1];
      std::int32_t i = rows.starts[row];
      for (; last - i >= CHAINS; i += CHAINS)
        a += term(i), b += term(i + 1), c += term(i + 2), d += term(i + 3);
      for (; i < last; i++) a += term(i);
      const Quad sum = (a + b) + (c + d);
      std::memcpy(sums + TEXEL * row, &sum, sizeof sum);
    }
  });
}

}  // namespace ringlight::RINGLIGHT_ISA
