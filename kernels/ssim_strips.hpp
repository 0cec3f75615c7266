// How an image is cut into strips and what a strip keeps at hand; shared by the two instruction sets.
#pragma once
#include <cstddef>

#include "ssim.hpp"

namespace ringlight::ssim {

constexpr int REACH = 5;                 // the window covers 11 = 2 * REACH + 1 pixels
constexpr int GROUP = 4;                 // rows blurred together: 14 rows are loaded for 4 results, not 44
constexpr int SPAN = GROUP + 2 * REACH;  // rows that one group reads
constexpr int RING = 16;                 // rows of SSIM derivatives kept: a power of two, SPAN in whole groups
constexpr int QUANTITIES = 3;            // forward blur(x), blur(x x), blur(x y); backward their three derivatives
constexpr int STRIP_ROWS = 100;          // at most; 10 rows of each neighbour are computed twice
constexpr int MARGIN = 16;               // zeros on each side of a row; one cache line, at least REACH
constexpr int ZEROED_ROWS = 4 + QUANTITIES * GROUP;  // zeros, three rows of sums, vertical blurs
constexpr int SCRATCH_ROWS = ZEROED_ROWS + QUANTITIES * (RING + 1);

// Internal linkage: each instruction set keeps its own copy.
static inline int strips_per_plane(int height) { return (height + STRIP_ROWS - 1) / STRIP_ROWS; }
static inline std::size_t row_floats(int width) {
  return (static_cast<std::size_t>(width) + MARGIN - 1) / MARGIN * MARGIN + 2 * MARGIN;
}
static inline std::size_t plane_floats(const Planes& planes) {
  return static_cast<std::size_t>(planes.height) * planes.width;
}

}  // namespace ringlight::ssim
