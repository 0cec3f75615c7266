// A sparse matrix times colours: blurred cubemaps of a light's texels, and the way back by the transposed matrix
// (src/ringlight/fields/prefilter.py).
#pragma once
#include <cstddef>
#include <cstdint>

#include "simd/dispatch.hpp"

namespace ringlight {

// Row i holds the entries from starts[i] to starts[i + 1].
struct SparseRows {
  std::size_t count;
  const std::int32_t *starts, *sources;
  const float* weights;
};

// values [. 4]; sums [count 4].
#define RINGLIGHT_SPARSE(isa) \
  namespace isa { \
  void sparse_product(const SparseRows&, const float* values, float* sums); \
  }
RINGLIGHT_EVERY_ISA(RINGLIGHT_SPARSE)
#undef RINGLIGHT_SPARSE

}  // namespace ringlight
