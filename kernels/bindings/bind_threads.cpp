#include <cstdlib>  // says whether this is glibc
#ifdef __GLIBC__
#include <malloc.h>
#endif

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "machine/memory.hpp"
#include "machine/parallel.hpp"
#include "simd/dispatch.hpp"
#include "simd/peak.hpp"

namespace ringlight {

namespace {

double run_multiply_adds(std::size_t rounds, const Tensor<float, -1>& sums) {
  const nb::gil_scoped_release unlocked;
  return RINGLIGHT_CHOSEN(multiply_adds)(sums.size(), rounds, sums.data());
}

// glibc hands freed memory back to the system, which must clear each page when it is asked for again. A training step
// allocates the same arrays as the one before it: at 400 x 400 pixels these pages cost a tenth of a step of Gaussians,
// and a fifth of one of tensor trains, whose arrays are above 32 MB, the most that a threshold of size can be.
bool keep_freed_memory() {
#ifdef __GLIBC__
  constexpr int MAPPED_ONE_BY_ONE = 0;
  constexpr int KEPT = 512 << 20;
  return mallopt(M_MMAP_MAX, MAPPED_ONE_BY_ONE) == 1 && mallopt(M_TRIM_THRESHOLD, KEPT) == 1;
#else
  return false;
#endif
}

}  // namespace

void bind_threads(nb::module_& module) {
  module.def("set_threads", &set_threads, "count"_a, "Threads for all kernels; 0 means every core.");
  module.def("threads", &threads, "Threads that kernels use.");
  module.def("set_memory", &set_memory, "bytes"_a,
             "The memory that this process may have, of which one buffer may take half; 0 means the machine's.");
  module.def("largest_buffer", &largest_buffer, "Bytes that one buffer may have.");
  module.def("keep_freed_memory", &keep_freed_memory,
             "For the rest of this process freed memory stays with it, but for what is free at the end of the heap "
             "beyond half a gigabyte, instead of going back to the system. Returns whether the C library can do so.");
  module.def("multiply_adds", &run_multiply_adds, "rounds"_a, "sums"_a,
             "x <- x / 2 + 1 in registers for n numbers that begin with 0 to n - 1, as fast as it goes; once for each "
             "element of sums, which receives the sum of the ends. Returns the floating-point operations done.");
}

}  // namespace ringlight
