// Densification statistics: how hard the image pulls at each Gaussian's centre.
#pragma once
#include <cstddef>

#include "simd/dispatch.hpp"

namespace ringlight {

// pull[i] += |gradient[i] * scale|, views[i] += 1 for each row that was drawn (radius > 0). Arrays of `count` rows;
// `gradient` and `radii` hold (x, y) pairs.
struct PullScale {
  float x, y;
};

#define RINGLIGHT_PULL(isa) \
  namespace isa { \
  void accumulate_pull(const float* gradient, const float* radii, PullScale scale, float* pull, float* views, \
                       std::size_t count); \
  }
RINGLIGHT_EVERY_ISA(RINGLIGHT_PULL)
#undef RINGLIGHT_PULL

}  // namespace ringlight
