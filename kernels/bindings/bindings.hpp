// One function per group of kernels, called by module.cpp.
#pragma once
#include <nanobind/nanobind.h>

namespace ringlight {

void bind_threads(nanobind::module_& module);  // thread pool, memory
void bind_camera(nanobind::module_& module);
void bind_raster(nanobind::module_& module);      // project, sort, bin, blend and their gradients
void bind_visibility(nanobind::module_& module);  // rows in the frustum, the learnable mask
void bind_ring(nanobind::module_& module);        // the light field
void bind_perceptron(nanobind::module_& module);  // the ring's heads at the nodes of their tables
void bind_mirror(nanobind::module_& module);      // what Gaussians emit for deferred shading
void bind_reflection(nanobind::module_& module);  // deferred shading of reflections
void bind_sh(nanobind::module_& module);          // colour from spherical harmonics
void bind_loss(nanobind::module_& module);        // photometric loss and the blurs of its target
void bind_step(nanobind::module_& module);        // Adam, densification statistics

}  // namespace ringlight
