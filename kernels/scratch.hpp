// Memory of one call of a kernel. Include from kernels/isa/*.cpp alone, see simd.hpp.
#pragma once
#include <cstddef>
#include <new>

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

}  // namespace ringlight::RINGLIGHT_ISA
