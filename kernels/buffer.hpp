// Memory that grows and is used again: no allocation in a training step once the sizes have settled.
#pragma once
#include <sys/mman.h>
#include <unistd.h>

#include <cstddef>
#include <cstdlib>
#include <limits>
#include <new>

namespace ringlight {

// Holds trivial values; contents are lost when it grows. Not for files in isa/ (see simd.hpp): hand them pointers.
template <class T>
class Buffer {
 public:
  Buffer() = default;
  Buffer(const Buffer&) = delete;
  Buffer& operator=(const Buffer&) = delete;
  ~Buffer() { std::free(data_); }

  // At least `count` values. Throws std::bad_alloc if that is more than half of the machine's memory, before asking for
  // it: Linux would promise the memory and kill the process later.
  T* reserve(std::size_t count) {
    if (count <= capacity_) return data_;
    if (count > physical_memory() / 2 / sizeof(T)) throw std::bad_alloc();
    const std::size_t wanted = count + count / 4;  // head room: the number of Gaussians grows step by step
    const std::size_t alignment = wanted * sizeof(T) >= HUGE_PAGE ? HUGE_PAGE : CACHE_LINE;
    const std::size_t bytes = (wanted * sizeof(T) + alignment - 1) / alignment * alignment;
    std::free(data_);
    capacity_ = 0;
    data_ = static_cast<T*>(std::aligned_alloc(alignment, bytes));
    if (!data_) throw std::bad_alloc();
    if (alignment == HUGE_PAGE) madvise(data_, bytes, MADV_HUGEPAGE);
    capacity_ = wanted;
    return data_;
  }

  T* data() const { return data_; }
  void swap(Buffer& other) {
    T* const data = data_;
    const std::size_t capacity = capacity_;
    data_ = other.data_, capacity_ = other.capacity_;
    other.data_ = data, other.capacity_ = capacity;
  }

 private:
  static constexpr std::size_t HUGE_PAGE = std::size_t{1} << 21, CACHE_LINE = 64;

  static std::size_t physical_memory() {
    const long pages = sysconf(_SC_PHYS_PAGES), size = sysconf(_SC_PAGESIZE);
    if (pages <= 0 || size <= 0) return std::numeric_limits<std::size_t>::max() / 2;
    return static_cast<std::size_t>(pages) * static_cast<std::size_t>(size);
  }

  T* data_ = nullptr;
  std::size_t capacity_ = 0;
};

}  // namespace ringlight
