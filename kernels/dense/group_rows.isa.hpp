// A group's rows in memory, one after another, as lanes; and back.
#pragma once
#include "dense/lane_panels.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

// rows[count][width] to lanes[width][GROUP], zero in lanes from `count` on; and back.
static inline void rows_to_lanes(const float* rows, int count, int width, float* lanes) {
  for (int first = 0; first < width; first += LANES)
    for (int half = 0; half < GROUP; half += LANES) {
      const int left = width - first < LANES ? width - first : LANES;
      Vec square[LANES];
      for (int i = 0; i < LANES; i++)
        square[i] = half + i < count ? load_first(rows + static_cast<std::size_t>(half + i) * width + first, left)
                                     : Vec(0.f);
      transpose(square);
      for (int i = 0; i < left; i++) store(lanes + (first + i) * GROUP + half, square[i]);
    }
}

static inline void lanes_to_rows(const float* lanes, int count, int width, float* blocks, float* rows) {
  to_rows(lanes, width, blocks);
  for (int first = 0; first < width; first += LANES) {
    const int left = width - first < LANES ? width - first : LANES;
    for (int lane = 0; lane < count; lane++)
      store_first(rows + static_cast<std::size_t>(lane) * width + first,
                  load(blocks + (first / LANES * GROUP + lane) * LANES), left);
  }
}

}  // namespace ringlight::RINGLIGHT_ISA
