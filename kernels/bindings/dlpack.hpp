// The part of DLPack's C layout (github.com/dmlc/dlpack, version 1.3) through which a tensor library shows its tensors
// without a Python call. Versions with the same major number only append.
#pragma once
#include <cstddef>
#include <cstdint>

namespace ringlight::dlpack {

inline constexpr std::int32_t CPU = 1;
inline constexpr std::uint8_t INT = 0, FLOAT = 2;
inline constexpr std::uint32_t MAJOR = 1;

struct Tensor {
  void* data;
  std::int32_t device, device_index, ndim;
  std::uint8_t code, bits;
  std::uint16_t lanes;
  std::int64_t *shape, *strides;  // strides in elements; null where rows follow one another
  std::uint64_t byte_offset;
};

struct Exchange {
  std::uint32_t major, minor;
  Exchange* older;
  int (*allocate)(...);
  int (*managed_from_object)(...);
  int (*managed_to_object)(...);
  // Fills in a tensor that is valid as long as the object keeps its memory; 0 for success. May be null.
  int (*from_object)(void* object, Tensor* tensor);
};

}  // namespace ringlight::dlpack
