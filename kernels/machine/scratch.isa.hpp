// Memory of one call of a kernel: a block, and its parts.
#pragma once
#include <cstddef>
#include <new>

#include "simd/simd.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

// Not initialised; begins on a cache line. Throws std::bad_alloc.
class Scratch {
 public:
  explicit Scratch(std::size_t bytes) : begin_(::operator new(bytes, LINE)) {}
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;
  ~Scratch() { ::operator delete(begin_, LINE); }

  float* floats() const { return static_cast<float*>(begin_); }
  void* data() const { return begin_; }

 private:
  static constexpr std::align_val_t LINE{64};
  void* begin_;
};

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
