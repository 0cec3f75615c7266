// Arrays as all kernels take them: contiguous, on the CPU, never converted. A training step passes seventy, so it
// counts that torch shows a tensor through its exchange table in a twentieth of the time that a call of __dlpack__
// takes.
#pragma once
#include <nanobind/ndarray.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <type_traits>

#include "bindings/dlpack.hpp"

namespace ringlight {

// Every refusal of a binding goes through here: Python sees a ValueError.
inline void require(bool holds, const char* otherwise) {
  if (!holds) throw std::invalid_argument(otherwise);
}

// The exchange table of a type of tensors, or null where its library has none.
const dlpack::Exchange* exchange_of(PyTypeObject* type);

// __dlpack__ refuses parameters: what can be detached is, everything else is returned as it is.
nanobind::object without_gradient(PyObject* source) noexcept;

// Whether the numbers in memory are the negatives of those that the tensor stands for. The exchange table does not say.
bool is_negated(PyObject* source) noexcept;

// Pointer and sizes of a tensor. `Sizes` are those that it must have, -1 for any; none at all for any number of
// dimensions. The object is kept alive, but a tensor of torch may be given other memory (`t.data = ...`, `t.resize_`):
// what keeps one of these from call to call must know that nobody does that meanwhile.
template <class Scalar, int... Sizes>
class Tensor {
 public:
  Scalar* data() const { return data_; }
  std::size_t ndim() const { return ndim_; }
  std::size_t shape(std::size_t axis) const { return shape_[axis]; }
  std::size_t size() const {
    std::size_t count = 1;
    for (std::size_t axis = 0; axis < ndim_; axis++) count *= shape_[axis];
    return count;
  }
  std::size_t nbytes() const { return size() * sizeof(Scalar); }

  // Whether `source` is such a tensor; what is no tensor of torch goes through nanobind.
  bool take(PyObject* source) noexcept {
    const dlpack::Exchange* exchange = exchange_of(Py_TYPE(source));
    dlpack::Tensor tensor;
    if (exchange == nullptr) return take_array(source);
    if (exchange->from_object(source, &tensor) != 0) {
      PyErr_Clear();
      return false;
    }
    if (!has_scalars(tensor) || tensor.device != dlpack::CPU || !adopt(tensor.ndim, tensor.shape)) return false;
    if (tensor.strides != nullptr && !is_contiguous(tensor.strides)) return false;
    if (is_negated(source)) return false;
    if (tensor.data != nullptr) data_ = reinterpret_cast<Scalar*>(static_cast<char*>(tensor.data) + tensor.byte_offset);
    owner_ = nanobind::borrow(source);
    return has_memory();
  }

 private:
  using Plain = std::remove_const_t<Scalar>;
  using Held = nanobind::ndarray<Scalar, nanobind::c_contig, nanobind::device::cpu>;
  static constexpr std::size_t MOST_AXES = 4;

  static bool has_scalars(const dlpack::Tensor& tensor) {
    const std::uint8_t code = std::is_floating_point_v<Plain> ? dlpack::FLOAT : dlpack::INT;
    return tensor.code == code && tensor.bits == 8 * sizeof(Plain) && tensor.lanes == 1;
  }

  template <class Size>
  bool adopt(std::size_t ndim, const Size* shape) {
    constexpr std::array<std::int64_t, sizeof...(Sizes)> wanted{Sizes...};
    if (ndim > MOST_AXES || (sizeof...(Sizes) > 0 && ndim != sizeof...(Sizes))) return false;
    ndim_ = ndim;
    for (std::size_t axis = 0; axis < ndim; axis++) {
      shape_[axis] = static_cast<std::size_t>(shape[axis]);
      if (axis < wanted.size() && wanted[axis] >= 0 && wanted[axis] != static_cast<std::int64_t>(shape[axis]))
        return false;
    }
    return true;
  }

  bool is_contiguous(const std::int64_t* strides) const {
    std::size_t expected = 1;
    if (size() == 0) return true;
    for (std::size_t axis = ndim_; axis-- > 0; expected *= shape_[axis])
      if (shape_[axis] != 1 && strides[axis] != static_cast<std::int64_t>(expected)) return false;
    return true;
  }

  bool take_array(PyObject* source) noexcept {
    if (!nanobind::try_cast(without_gradient(source), held_, false)) return false;
    std::array<std::size_t, MOST_AXES> shape{};
    for (std::size_t axis = 0; axis < held_.ndim() && axis < MOST_AXES; axis++) shape[axis] = held_.shape(axis);
    data_ = held_.data();
    return adopt(held_.ndim(), shape.data()) && has_memory();
  }

  // A tensor may have a shape and nothing behind it: its storage was freed, or its zeros are only meant.
  bool has_memory() const { return data_ != nullptr || size() == 0; }

  Scalar* data_ = nullptr;
  std::size_t ndim_ = 0;
  std::array<std::size_t, MOST_AXES> shape_{};
  nanobind::object owner_;
  Held held_;
};

using Array = Tensor<float>;
using Input = Tensor<const float>;

}  // namespace ringlight

namespace nanobind::detail {

template <class Scalar, int... Sizes>
struct type_caster<ringlight::Tensor<Scalar, Sizes...>> {
  using Taken = ringlight::Tensor<Scalar, Sizes...>;
  NB_TYPE_CASTER(Taken, const_name("torch.Tensor"))
  bool from_python(handle source, std::uint8_t, cleanup_list*) noexcept { return value.take(source.ptr()); }
};

}  // namespace nanobind::detail
