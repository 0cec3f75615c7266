#include "encoding/directional_encoding.hpp"

#include "machine/parallel.hpp"
#include "simd/row_columns.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

constexpr std::size_t ROWS_PER_PIECE = 1024;
constexpr int BLOCKS = (CODE_WIDTH + LANES - 1) / LANES;

// Sixteen codes as columns: harmonic (l, m) is (x + iy)^m times a polynomial of z, times exp(-roughness l (l + 1) / 2).
void encode(const Vec direction[3], Vec roughness, const float* polynomials, Vec code[BLOCKS * LANES]) {
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
  for (int c = CODE_WIDTH; c < BLOCKS * LANES; c++) code[c] = Vec(0.f);
}

}  // namespace

void directional_encoding(std::size_t count, const float* directions, const float* roughness,
                          const float* polynomials, std::size_t stride, float* rows) {
  parallel_ranges(count, ROWS_PER_PIECE, [=](std::size_t begin, std::size_t end) {
    for (std::size_t first = begin; first < end; first += LANES) {
      const int some = end - first < LANES ? static_cast<int>(end - first) : LANES;
      Vec direction[LANES], code[BLOCKS * LANES];
      take_columns(directions + 3 * first, 3, some, direction);
      encode(direction, load_first(roughness + first, some), polynomials, code);
      for (int block = 0; block < BLOCKS; block++) {
        const int left = CODE_WIDTH - block * LANES, width = left < LANES ? left : LANES;
        transpose(code + block * LANES);
        for (int i = 0; i < some; i++)
          store_first(rows + (first + i) * stride + block * LANES, code[block * LANES + i], width);
      }
    }
  });
}

}  // namespace ringlight::RINGLIGHT_ISA
