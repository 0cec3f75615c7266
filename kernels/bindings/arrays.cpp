#include "bindings/arrays.hpp"

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

bool is_negated(PyObject* source) noexcept {
  static PyObject* const name = PyUnicode_InternFromString("is_neg");
  PyObject* const answer = PyObject_CallMethodNoArgs(source, name);
  if (answer == nullptr) PyErr_Clear();  // no tensor of torch
  Py_XDECREF(answer);
  return answer == Py_True;
}

const dlpack::Exchange* exchange_of(PyTypeObject* type) {
  struct Known {
    PyTypeObject* type;
    const dlpack::Exchange* exchange;
  };
  // Two types make up nearly all arguments, torch.Tensor and torch.nn.Parameter. Kept types stay alive, so that no
  // other takes their address; Python's lock guards the places.
  static Known known[4] = {};
  static unsigned next = 0;
  for (const Known& one : known)
    if (one.type == type) return one.exchange;
  // To look it up and to drop a type may run Python, which may come here again: no place is half filled meanwhile.
  const dlpack::Exchange* const exchange = find_exchange(type);
  Known& place = known[next++ % 4];
  PyTypeObject* const dropped = place.type;
  Py_INCREF(reinterpret_cast<PyObject*>(type));
  place = {type, exchange};
  Py_XDECREF(reinterpret_cast<PyObject*>(dropped));
  return exchange;
}

}  // namespace ringlight
