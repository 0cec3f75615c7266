#include "machine/memory.hpp"

#include <unistd.h>

#include <atomic>
#include <limits>

namespace ringlight {

namespace {

std::atomic<std::size_t> stated{0};

std::size_t physical_memory() {
  const long pages = sysconf(_SC_PHYS_PAGES), size = sysconf(_SC_PAGESIZE);
  if (pages <= 0 || size <= 0) return std::numeric_limits<std::size_t>::max();
  return static_cast<std::size_t>(pages) * static_cast<std::size_t>(size);
}

}  // namespace

void set_memory(std::size_t bytes) { stated = bytes; }

std::size_t largest_buffer() {
  const std::size_t bytes = stated;
  return (bytes ? bytes : physical_memory()) / 2;
}

}  // namespace ringlight
