#include "bindings.hpp"

namespace ringlight {

void bind_field(nanobind::module_&) {}

}  // namespace ringlight
