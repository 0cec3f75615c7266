// Which 4 x 4 blocks of a tile an ellipse touches: one 64-bit mask per Gaussian, sixteen Gaussians at once.
// Exact up to a margin, and the largest single saving of the rasterizer: against the bounding box on 16 x 16 tiles
// four to seven times fewer pixels are evaluated.
#pragma once
#include "raster/raster.hpp"
#include "simd/simd.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

// `fields` are the transposed records (one Vec per field, one Gaussian per lane); (left, top) is the tile's corner in
// pixels. Bit 8 row + column of masks[i] is the block of Gaussian i.
RINGLIGHT_INLINE void find_blocks(const Vec* fields, float left, float top, std::uint64_t masks[LANES]) {
  constexpr float MARGIN = 2e-3f;  // pixels; rounding must not lose a block
  constexpr float BLOCK = convention::BLOCK;
  const Vec shear = fields[SHEAR], spread = fields[SPREAD], reach2 = fields[REACH2], turn = fields[TURN];
  const Vec zero(0.f), quarter(1 / BLOCK), row_reach2 = reach2 + Vec(MARGIN), minus_turn = -turn;
  // Block column c holds the pixel centres 4 c + 0.5 .. 4 c + 3.5.
  const Vec to_first = fields[CENTER_X] - Vec(left + BLOCK - 0.5f + MARGIN);
  const Vec to_last = fields[CENTER_X] - Vec(left + 0.5f - MARGIN);
  Vec upper = Vec(top + 0.5f) - fields[CENTER_Y];
  IVec halves[2] = {ivec(0), ivec(0)};
#pragma GCC unroll 8
  for (int row = 0; row < 8; row++) {
    const Vec lower = upper + Vec(BLOCK - 1);
    const Vec left_at = min(max(minus_turn, upper), lower), right_at = min(max(turn, upper), lower);
    const Vec nearest = min(max(zero, upper), lower);
    const Vec left_width = sqrt(max(fnma(left_at, left_at, reach2), zero));
    const Vec right_width = sqrt(max(fnma(right_at, right_at, reach2), zero));
    const Vec first = fnma(spread, left_width, fma(shear, left_at, to_first)) * quarter;
    const Vec last = fma(spread, right_width, fma(shear, right_at, to_last)) * quarter;
    const IVec first_column = truncate(ceil(min(max(first, zero), Vec(8.f))));
    const IVec last_column = truncate(floor(max(min(last, Vec(7.f)), Vec(-1.f))));
    const IVec from_first = shift_left(ivec(0xff), first_column) & ivec(0xff);
    const IVec to_last_bits = shift_right(ivec(0xff), ivec(7) - last_column);
    const IVec blocks = keep(ge(row_reach2, nearest * nearest), from_first & to_last_bits);
    IVec& half = halves[row / 4];
    if (row % 4 == 0) half = blocks;
    if (row % 4 == 1) half = half | shift_left<8>(blocks);
    if (row % 4 == 2) half = half | shift_left<16>(blocks);
    if (row % 4 == 3) half = half | shift_left<24>(blocks);
    upper = upper + Vec(BLOCK);
  }
  store_words(masks, halves[0], halves[1]);
}

}  // namespace ringlight::RINGLIGHT_ISA
