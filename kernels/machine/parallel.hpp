// Threads: one pool per process, parallel loops whose results do not depend on the number of threads.
//
// A loop is cut into fixed pieces that threads claim from a counter. A piece may only write what it owns; sums
// over pieces are taken by the caller in piece order. Hence the same bits for 1, 2 or 64 threads.
#pragma once
#include <cstddef>
#include <memory>
#include <type_traits>

namespace ringlight {

// Threads that a parallel loop uses, the caller included, at most 1024. 0 sets the number of cores this process may
// run on.
void set_threads(int count);
int threads();

namespace detail {
using Body = void (*)(void* closure, std::size_t piece);
void run(std::size_t pieces, Body body, void* closure);
}  // namespace detail

// Calls body(piece) for every piece in [0, pieces), flush-to-zero on, in any order and from any thread.
// The caller works too and never waits for a worker that has not started: a busy machine cannot stall it.
// An exception of a piece ends the loop and reaches the caller. A body must not begin a loop of its own.
template <class F>
void parallel_for(std::size_t pieces, F&& body) {
  using Closure = std::remove_reference_t<F>;
  detail::run(pieces, [](void* closure, std::size_t piece) { (*static_cast<Closure*>(closure))(piece); },
              const_cast<void*>(static_cast<const void*>(std::addressof(body))));
}

// Calls body(begin, end) for consecutive ranges of at most `grain` items that cover [0, count).
template <class F>
void parallel_ranges(std::size_t count, std::size_t grain, F&& body) {
  parallel_for((count + grain - 1) / grain, [&](std::size_t piece) {
    const std::size_t begin = piece * grain;
    body(begin, begin + grain < count ? begin + grain : count);
  });
}

}  // namespace ringlight
