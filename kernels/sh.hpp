// Colour from spherical harmonics (src/ringlight/core/sh_basis.py) towards a camera, and its gradient.
#pragma once
#include <cstddef>

#include "every_isa.hpp"

namespace ringlight {

constexpr int SH_REST = 45;  // coefficients after the constant ones: 15 harmonics by 3 colours

// N rows as they lie in the table. Only the harmonics up to `degree` (0 to 3) count.
struct Harmonics {
  const float* means;     // [N 3] world units
  const float* constant;  // [N 3]
  const float* rest;      // [N 15 3]
  std::size_t count;
  float position[3];      // the camera, world units
  int degree;
};

// Overwritten, every row: [N 3], [N 3], [N 15 3]; zero for harmonics above the degree.
struct HarmonicsGradient {
  float* means;
  float* constant;
  float* rest;
};

#define RINGLIGHT_HARMONICS(isa) \
  namespace isa { \
  void sh_colors(const Harmonics& table, float* colors); \
  void sh_gradient(const Harmonics& table, const float* upstream, const HarmonicsGradient& gradient); \
  }
RINGLIGHT_EVERY_ISA(RINGLIGHT_HARMONICS)
#undef RINGLIGHT_HARMONICS

}  // namespace ringlight
