// Densification statistics: the screen-space gradient of each Gaussian's centre, summed over views.
#pragma once
#include <cstddef>

#include "simd/dispatch.hpp"

namespace ringlight {

// total[i] += |gradient[i] * scale|, views[i] += 1 for each row that was drawn (radius > 0). Arrays of `count` rows;
// `gradient` and `radii` hold (x, y) pairs.
struct ScreenScale {
  float x, y;
};

#define RINGLIGHT_SCREEN_GRADIENT(isa) \
  namespace isa { \
  void accumulate_screen_gradient(const float* gradient, const float* radii, ScreenScale scale, float* total, \
                                  float* views, std::size_t count); \
  }
RINGLIGHT_EVERY_ISA(RINGLIGHT_SCREEN_GRADIENT)
#undef RINGLIGHT_SCREEN_GRADIENT

}  // namespace ringlight
