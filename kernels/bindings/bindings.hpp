// One function per group of kernels, called by module.cpp.
#pragma once
#include <nanobind/nanobind.h>

namespace ringlight {

namespace nb = nanobind;
using namespace nb::literals;

void bind_threads(nb::module_& module);  // thread pool, memory
void bind_camera(nb::module_& module);
void bind_raster(nb::module_& module);      // project, sort, bin, blend and their gradients
void bind_visibility(nb::module_& module);  // rows in the frustum, the learnable mask
void bind_ring(nb::module_& module);        // the light field
void bind_perceptron(nb::module_& module);  // the ring's heads at the nodes of their tables
void bind_mirror(nb::module_& module);      // what Gaussians emit for deferred shading
void bind_reflection(nb::module_& module);  // deferred shading of reflections
void bind_environment(nb::module_& module);  // deferred shading by a cubemap
void bind_shaded(nb::module_& module);      // Gaussians that are shaded one by one
void bind_illuminated(nb::module_& module);  // what a field of light adds to Gaussians
void bind_sh(nb::module_& module);          // colour from spherical harmonics
void bind_loss(nb::module_& module);        // photometric loss and the blurs of its target
void bind_volume(nb::module_& module);      // marching along rays through a volume
void bind_volume_shading(nb::module_& module);  // the network that makes colours of a volume's features
void bind_trains(nb::module_& module);      // nodes of tensor trains around points
void bind_step(nb::module_& module);        // Adam, densification statistics

}  // namespace ringlight
