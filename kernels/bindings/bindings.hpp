// One function per group of kernels, called by module.cpp.
#pragma once
#include <nanobind/nanobind.h>

namespace ringlight {

void bind_threads(nanobind::module_& module);  // thread pool: machine/parallel.hpp
void bind_raster(nanobind::module_& module);   // rasterizer: project, sort, blend and their gradients
void bind_fit(nanobind::module_& module);      // Adam, densification statistics
void bind_sh(nanobind::module_& module);       // colour from spherical harmonics
void bind_loss(nanobind::module_& module);     // photometric loss and the blurs of its target
void bind_field(nanobind::module_& module);    // the tensor-ring light field
void bind_heads(nanobind::module_& module);    // the ring's heads at the nodes of their tables
void bind_mirror(nanobind::module_& module);      // what Gaussians emit for deferred shading
void bind_reflection(nanobind::module_& module);  // deferred shading of reflections
void bind_visibility(nanobind::module_& module);  // rows in the frustum, the learnable mask

}  // namespace ringlight
