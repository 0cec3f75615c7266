// The compiled module. Each group of kernels binds itself in its own file of this folder; nothing outside it
// includes nanobind.
#include <nanobind/nanobind.h>

#include "bindings/bindings.hpp"
#include "simd/dispatch.hpp"

NB_MODULE(_kernels, module) {
  module.doc() = "CPU kernels of ringlight: functions fill arrays that the caller made, contiguous float32 on the CPU.";
  module.def("isa", [] { return ringlight::isa_name(ringlight::current_isa()); },
             "Instruction set in use: 'avx512', 'avx2' or 'generic'.");
  ringlight::bind_threads(module);
  ringlight::bind_camera(module);
  ringlight::bind_raster(module);
  ringlight::bind_visibility(module);
  ringlight::bind_ring(module);
  ringlight::bind_perceptron(module);
  ringlight::bind_mirror(module);
  ringlight::bind_reflection(module);
  ringlight::bind_environment(module);
  ringlight::bind_shaded(module);
  ringlight::bind_illuminated(module);
  ringlight::bind_sh(module);
  ringlight::bind_loss(module);
  ringlight::bind_volume(module);
  ringlight::bind_volume_shading(module);
  ringlight::bind_trains(module);
  ringlight::bind_step(module);
}
