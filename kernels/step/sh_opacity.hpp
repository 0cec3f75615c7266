// Opacities that change with the direction, as factors on those of the table
// (src/ringlight/color/glossy_harmonics.py is the reference).
#pragma once
#include "simd/dispatch.hpp"
#include "step/sh.hpp"

namespace ringlight {

// `harmonics` has one channel: no constant, and K floats a row of rest. The opacity towards the camera is
// sigmoid(logit) + rest basis, clamped to [0, 1]; the factor is that over sigmoid(logit), or over `least` if that is
// more.
struct DirectionalOpacities {
  Harmonics harmonics;
  const float* logits;  // [N]
  float least;
};

// `means` [N 3] and `logits` [N] are added to, `rest` [N K] is filled in, with zeros above the degree.
struct DirectionalOpacityGradients {
  float *means, *logits, *rest;
};

// Where the harmonics are mixed of a few that all Gaussians share, rest = weights basis, `basis` of SharedBasis is
// [K 15], and they are added to the logit: the factor is sigmoid(logit + rest basis) over sigmoid(logit), or over
// `least` (src/ringlight/color/basis_opacities.py is the reference). `weights` [N K] is added to, `basis` is filled in.
struct BasisOpacityGradients {
  float *means, *logits, *weights, *basis;
};

#define RINGLIGHT_OPACITIES(isa)                                                            \
  namespace isa {                                                                           \
  void sh_opacity_factors(const DirectionalOpacities& table, float* factors);               \
  void sh_opacity_gradient(const DirectionalOpacities& table, const float* by_factors,      \
                           const DirectionalOpacityGradients& to);                          \
  void sh_basis_opacity_factors(const DirectionalOpacities& table, const SharedBasis& mixed, float* factors); \
  void sh_basis_opacity_gradient(const DirectionalOpacities& table, const SharedBasis& mixed, \
                                 const float* by_factors, const BasisOpacityGradients& to); \
  }
RINGLIGHT_EVERY_ISA(RINGLIGHT_OPACITIES)
#undef RINGLIGHT_OPACITIES

}  // namespace ringlight
