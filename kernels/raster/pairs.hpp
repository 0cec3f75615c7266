// How much one view asked of the blending kernels.
#pragma once
#include <cstdint>

#include "raster/raster.hpp"

namespace ringlight {

// A pair is one Gaussian at one pixel.
struct PairCounts {
  std::uint64_t evaluated;  // lanes of the blocks that were walked, those beyond the image's border included
  std::uint64_t blended;    // of these, pixels of the image with alpha of 1/255 or more and not finished: changed by it
};

// Blends the view of the last forward pass once more, pixel by pixel in plain C++. Slow; rounds its own way, so that a
// pair on the edge of an ellipse may count here and not there.
PairCounts count_pairs(const View& view);

}  // namespace ringlight
