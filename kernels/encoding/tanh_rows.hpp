// Hyperbolic tangents of chosen rows, written into columns of a network's inputs.
#pragma once
#include <cstddef>
#include <cstdint>

#include "simd/dispatch.hpp"

namespace ringlight {

// values [.. width]; row i is that of numbers[i], or where that is null the i-th. Rows are `stride` floats apart.
#define RINGLIGHT_TANH_ROWS(isa) \
  namespace isa { \
  void tanh_rows(std::size_t count, std::size_t width, const float* values, const std::int32_t* numbers, \
                 std::size_t stride, float* rows); \
  }
RINGLIGHT_EVERY_ISA(RINGLIGHT_TANH_ROWS)
#undef RINGLIGHT_TANH_ROWS

}  // namespace ringlight
