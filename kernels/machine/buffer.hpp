// Memory that grows and is used again: no allocation in a training step once the sizes have settled.
#pragma once
#include <sys/mman.h>

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <new>

#include "machine/memory.hpp"

namespace ringlight {

// Holds trivial values; contents are lost when it grows. Not for x.isa.cpp (see simd/simd.isa.hpp): hand them pointers.
template <class T>
class Buffer {
 public:
  Buffer() = default;
  Buffer(const Buffer&) = delete;
  Buffer& operator=(const Buffer&) = delete;
  ~Buffer() { std::free(data_); }

  // At least `count` values. Throws std::bad_alloc if that is more than largest_buffer(), before asking for it: Linux
  // would promise the memory and kill the process later.
  T* reserve(std::size_t count) {
    if (count <= capacity_) return data_;
    const std::size_t most = largest_buffer() / sizeof(T);
    if (count > most) throw std::bad_alloc();
    // Head room: the number of Gaussians grows step by step.
    const std::size_t wanted = std::min(count + count / 4, most);
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

  T* data_ = nullptr;
  std::size_t capacity_ = 0;
};

}  // namespace ringlight
