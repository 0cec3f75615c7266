// The most that this processor's fused multiply-adds reach: what other kernels are compared with.
#pragma once
#include <cstddef>

#include "every_isa.hpp"

namespace ringlight {

// Independent chains of multiply-adds in registers, `pieces` loops of `rounds` each, spread over the threads. Returns
// the floating-point operations done, two for a multiply-add.
#define RINGLIGHT_DECLARE_PEAK(isa)                               \
  namespace isa {                                                 \
  double multiply_adds(std::size_t pieces, std::size_t rounds);   \
  }
RINGLIGHT_EVERY_ISA(RINGLIGHT_DECLARE_PEAK)
#undef RINGLIGHT_DECLARE_PEAK

}  // namespace ringlight
