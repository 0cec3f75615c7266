// The most that this processor's fused multiply-adds reach: what other kernels are compared with.
#pragma once
#include <cstddef>

#include "simd/dispatch.hpp"

namespace ringlight {

// Chains x <- x / 2 + 1 in registers, one for each of n numbers that begin with 0 to n - 1: `pieces` loops of `rounds`
// each, spread over the threads. A piece leaves the sum of its numbers in `sums`. Returns the floating-point operations
// done, two for a multiply-add: 2 n rounds pieces.
#define RINGLIGHT_DECLARE_PEAK(isa)                                            \
  namespace isa {                                                              \
  double multiply_adds(std::size_t pieces, std::size_t rounds, float* sums);   \
  }
RINGLIGHT_EVERY_ISA(RINGLIGHT_DECLARE_PEAK)
#undef RINGLIGHT_DECLARE_PEAK

}  // namespace ringlight
