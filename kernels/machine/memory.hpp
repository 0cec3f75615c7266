// The memory that buffers may grow into: one number for the process, which Python knows better than the system's pages,
// for it looks at containers and limits too (core/memory.py).
#pragma once
#include <cstddef>

namespace ringlight {

// Bytes of memory, used or not; 0 sets those of the machine.
void set_memory(std::size_t bytes);

// Bytes that one buffer may have: half of the memory.
std::size_t largest_buffer();

}  // namespace ringlight
