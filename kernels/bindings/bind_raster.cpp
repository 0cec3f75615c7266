#include "bindings.hpp"

namespace ringlight {

void bind_raster(nanobind::module_&) {}

}  // namespace ringlight
