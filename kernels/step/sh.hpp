// Colour from spherical harmonics (src/ringlight/core/sh_basis.py) towards a camera, its gradient, and the update of
// the coefficients.
#pragma once
#include <cstddef>

#include "simd/dispatch.hpp"
#include "step/adam.hpp"

namespace ringlight {

constexpr int SH_REST = 45;   // most coefficients after the constant ones: 15 harmonics by 3 colours
constexpr int SH_SLOPES = 9;  // d(colour) / d(mean): 3 colours by 3 axes

// N rows as they lie in the table. Only the harmonics up to `degree` (0 to 3) count, which may be fewer than the K that
// are stored (0, 3, 8 or 15).
struct Harmonics {
  const float* means;     // [N 3] world units
  const float* constant;  // [N 3]
  const float* rest;      // [N K 3]
  int stored;             // 3 K, floats a row of rest
  std::size_t count;
  float position[3];      // the camera, world units
  int degree;
  bool by_logits = false;  // whether `constant` holds logits of the colour that harmonics are added to
};

// Coefficients that are not stored, but mixed of a few that all Gaussians share: rest = weights basis.
struct SharedBasis {
  const float* weights;  // [N K]
  const float* basis;    // [K 15 3], of opacities [K 15]
  int count;             // K, 1 to SH_MAX_BASIS
};

// dL/d(colour) [N 3], and what sh_colors left.
struct HarmonicsUpstream {
  const float *upstream, *colors, *slopes;
  std::size_t count;
};

// [N 3] each, every row; `means` is added to where `adds` says so, and overwritten otherwise.
struct HarmonicsGradient {
  float *means, *constant;
  bool adds;
};

// `slopes` ([N, rounded up to 16, x 9], in an order of the kernels' own) may be null where no gradient is wanted.
// Colours are clamped at black; a clamped one is negative zero.
// `by_constant`: sh_gradient's; means, position and degree as they were then. sh_rest_adam returns what adam does.
// sh_basis_gradient fills by_weights [N K] and by_basis [K 15 3].
#define RINGLIGHT_HARMONICS(isa)                                                                          \
  namespace isa {                                                                                         \
  void sh_colors(const Harmonics& table, float* colors, float* slopes);                                   \
  void sh_basis_colors(const Harmonics& table, const SharedBasis& mixed, float* colors, float* slopes);   \
  void sh_basis_gradient(const Harmonics& table, const SharedBasis& mixed, const float* by_constant,      \
                         float* by_weights, float* by_basis);                                             \
  void sh_gradient(const HarmonicsUpstream& from, const HarmonicsGradient& to);                           \
  void sh_rest_gradient(const Harmonics& table, const float* by_constant, float* by_rest);                \
  std::size_t sh_rest_adam(const Harmonics& table, const float* by_constant, const AdamRows& rows,        \
                           const AdamStep& step);                                                       \
  }
RINGLIGHT_EVERY_ISA(RINGLIGHT_HARMONICS)
#undef RINGLIGHT_HARMONICS

}  // namespace ringlight
