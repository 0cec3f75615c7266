// What threads need to know of the processor they run on. All else is in the SIMD layer (simd/simd.isa.hpp).
#pragma once
#ifdef __x86_64__
#include <immintrin.h>
#endif

#include <cstdint>

namespace ringlight {

// Takes little while a thread waits in a loop.
inline void relax() {
#if defined __x86_64__
  _mm_pause();
#elif defined __aarch64__
  asm volatile("isb");  // waits some 50 cycles; "yield" does nothing on most cores
#endif
}

// While it lives, this thread's floats below 1e-38 are zero: subnormal alphas cost a hundred cycles each.
class FlushToZero {
 public:
  FlushToZero() : saved_(mode()) { set_mode(saved_ | BITS); }
  ~FlushToZero() { set_mode(saved_); }
  FlushToZero(const FlushToZero&) = delete;
  FlushToZero& operator=(const FlushToZero&) = delete;

 private:
#if defined __x86_64__
  static constexpr std::uint64_t BITS = 0x8040;  // FTZ and DAZ of MXCSR
  static std::uint64_t mode() { return _mm_getcsr(); }
  static void set_mode(std::uint64_t mode) { _mm_setcsr(static_cast<unsigned>(mode)); }
#elif defined __aarch64__
  static constexpr std::uint64_t BITS = std::uint64_t{1} << 24;  // FZ of FPCR
  static std::uint64_t mode() {
    std::uint64_t mode;
    asm volatile("mrs %0, fpcr" : "=r"(mode));
    return mode;
  }
  static void set_mode(std::uint64_t mode) { asm volatile("msr fpcr, %0" : : "r"(mode)); }
#else
  static constexpr std::uint64_t BITS = 0;
  static std::uint64_t mode() { return 0; }
  static void set_mode(std::uint64_t) {}
#endif

  std::uint64_t saved_;
};

}  // namespace ringlight
