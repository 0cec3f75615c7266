#include "bindings.hpp"
#include "parallel.hpp"

namespace nb = nanobind;

namespace ringlight {

void bind_threads(nb::module_& module) {
  module.def("set_threads", &set_threads, nb::arg("count"), "Threads for all kernels; 0 means every core.");
  module.def("threads", &threads, "Threads that kernels use.");
}

}  // namespace ringlight
