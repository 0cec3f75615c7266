// Arrays as most kernels take them: contiguous float32 of any shape, whose sizes the binding compares.
#pragma once
#include <nanobind/ndarray.h>

#include <stdexcept>

namespace ringlight {

using Array = nanobind::ndarray<float, nanobind::c_contig, nanobind::device::cpu>;
using Input = nanobind::ndarray<const float, nanobind::c_contig, nanobind::device::cpu>;

inline void check(bool right, const char* message) {
  if (!right) throw std::invalid_argument(message);
}

}  // namespace ringlight
