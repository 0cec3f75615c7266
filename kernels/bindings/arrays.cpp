#include "arrays.hpp"

namespace nb = nanobind;

namespace ringlight {
namespace {

const dlpack::Exchange* find_exchange(PyTypeObject* type) {
  const nb::object capsule = nb::getattr(nb::handle(reinterpret_cast<PyObject*>(type)), "__dlpack_c_exchange_api__",
                                         nb::none());
  if (!PyCapsule_CheckExact(capsule.ptr())) return nullptr;
  auto* exchange = static_cast<dlpack::Exchange*>(PyCapsule_GetPointer(capsule.ptr(), "dlpack_exchange_api"));
  if (exchange == nullptr) PyErr_Clear();
  while (exchange != nullptr && exchange->major != dlpack::MAJOR) exchange = exchange->older;
  return exchange != nullptr && exchange->from_object != nullptr ? exchange : nullptr;
}

}  // namespace

nb::object without_gradient(PyObject* source) noexcept {
  PyObject* detached = PyObject_CallMethod(source, "detach", nullptr);
  if (detached == nullptr) PyErr_Clear();
  return detached != nullptr ? nb::steal(detached) : nb::borrow(source);
}

const dlpack::Exchange* exchange_of(PyTypeObject* type) {
  struct Known {
    PyTypeObject* type;
    const dlpack::Exchange* exchange;
  };
  // Two types make up nearly all arguments, torch.Tensor and torch.nn.Parameter. Kept types stay alive, so that no other
  // takes their address; Python's lock guards the places.
  static Known known[4] = {};
  static unsigned next = 0;
  for (const Known& one : known)
    if (one.type == type) return one.exchange;
  Known& place = known[next++ % 4];
  Py_XDECREF(reinterpret_cast<PyObject*>(place.type));
  Py_INCREF(reinterpret_cast<PyObject*>(type));
  place = {type, find_exchange(type)};
  return place.exchange;
}

}  // namespace ringlight
