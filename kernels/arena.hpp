// One block of memory, handed out part by part. Include from kernels/isa/*.cpp alone, see simd.hpp.
#pragma once
#include "simd.hpp"

namespace ringlight::RINGLIGHT_ISA {

// Hands out consecutive parts of one block of memory; with a null block it only counts.
struct Arena {
  float* block;
  std::size_t used = 0;

  float* take(std::size_t count) {
    float* part = block ? block + used : nullptr;
    used += (count + LANES - 1) / LANES * LANES;
    return part;
  }
};

}  // namespace ringlight::RINGLIGHT_ISA
