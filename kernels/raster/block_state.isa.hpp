// A block of a tile while it is blended.
#pragma once
#include "raster/raster.hpp"
#include "raster/tile_shader.hpp"
#include "simd/simd.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

// State of a block between chunks: 16 running transmittances, 16 final ones, then 16 values of each channel. A running
// one falls on past the threshold, which tells that its pixel is finished.
enum State { RUNNING = BLOCK_RUNNING, FINAL = BLOCK_FINAL, COLOR = BLOCK_CHANNELS };

// Rows of the chunk that touch one block, in order; one more number follows the last.
struct RowList {
  const float* rows;
  const std::uint8_t* numbers;
  int count;
};

// Stops the blocks through whose pixels less than EARLY_STOP of what lies behind shows, as if that were what is in
// front; returns the others. The final transmittance says it: a finished pixel keeps what was left before the Gaussian
// that finished it, up to a tenth, while its running one is past the threshold.
RINGLIGHT_INLINE std::uint64_t stop_early(std::uint64_t blocks, float* states, int floats) {
  std::uint64_t open = blocks;
  for (std::uint64_t left = blocks; left; left &= left - 1) {
    const int block = __builtin_ctzll(left);
    float* const state = states + block * floats;
    if (any(ge(load(state + FINAL), Vec(convention::EARLY_STOP)))) continue;
    const Vec filling = Vec(1.f) / (Vec(1.f) - load(state + FINAL));
    for (int i = COLOR; i < floats; i += LANES) store(state + i, load(state + i) * filling);
    store(state + FINAL, Vec(0.f));
    open &= ~(std::uint64_t{1} << block);
  }
  return open;
}

}  // namespace ringlight::RINGLIGHT_ISA
