// Integrated directional encoding (Ref-NeRF, Verbin et al. 2022, section 4): harmonics of the levels 1, 2, 4 and 8 of a
// direction, each level faded as by a roughness (src/ringlight/fields/directional_encoding.py is the reference).
#pragma once
#include <cstddef>

#include "simd/dispatch.hpp"

namespace ringlight {

constexpr int CODE_LEVELS = 4, HIGHEST_LEVEL = 8;  // level l has l + 1 harmonics, of orders 0 to l
constexpr int CODE_PAIRS = 19;                     // of real and imaginary parts
constexpr int CODE_WIDTH = 2 * CODE_PAIRS;

// directions [N 3], unit length; roughness [N]; polynomials [CODE_PAIRS HIGHEST_LEVEL + 1], coefficients of powers of
// z, the constant first. Rows are `stride` floats apart; real parts first.
#define RINGLIGHT_ENCODING(isa) \
  namespace isa { \
  void directional_encoding(std::size_t count, const float* directions, const float* roughness, \
                            const float* polynomials, std::size_t stride, float* rows); \
  }
RINGLIGHT_EVERY_ISA(RINGLIGHT_ENCODING)
#undef RINGLIGHT_ENCODING

}  // namespace ringlight
