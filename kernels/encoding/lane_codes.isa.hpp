// Integrated directional encodings of sixteen directions, one per lane.
#pragma once
#include "encoding/directional_encoding.hpp"
#include "simd/simd.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

constexpr int CODE_BLOCKS = (CODE_WIDTH + LANES - 1) / LANES;

// Sixteen codes as columns: harmonic (l, m) is (x + iy)^m times a polynomial of z, times exp(-roughness l (l + 1) / 2).
static inline void encode(const Vec direction[3], Vec roughness, const float* polynomials,
                          Vec code[CODE_BLOCKS * LANES]) {
  Vec real[HIGHEST_LEVEL + 1], imaginary[HIGHEST_LEVEL + 1];
  real[0] = Vec(1.f), imaginary[0] = Vec(0.f);
  for (int m = 1; m <= HIGHEST_LEVEL; m++) {
    real[m] = fnma(direction[1], imaginary[m - 1], direction[0] * real[m - 1]);
    imaginary[m] = fma(direction[1], real[m - 1], direction[0] * imaginary[m - 1]);
  }
  int pair = 0;
  for (int level = 1; level <= HIGHEST_LEVEL; level *= 2) {
    const Vec faded = exp(roughness * Vec(-0.5f * level * (level + 1)));
    for (int m = 0; m <= level; m++, pair++) {
      const float* of = polynomials + pair * (HIGHEST_LEVEL + 1);
      Vec value(of[level - m]);
      for (int power = level - m - 1; power >= 0; power--) value = fma(value, direction[2], Vec(of[power]));
      value = value * faded;
      code[pair] = value * real[m];
      code[CODE_PAIRS + pair] = value * imaginary[m];
    }
  }
  for (int c = CODE_WIDTH; c < CODE_BLOCKS * LANES; c++) code[c] = Vec(0.f);
}

}  // namespace ringlight::RINGLIGHT_ISA
