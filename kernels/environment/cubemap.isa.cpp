// From logits to colours with a border, and the way back.
#include <algorithm>

#include "environment/environment.hpp"
#include "machine/parallel.hpp"
#include "simd/simd.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

constexpr float MEETING = 1.f / 3;  // a corner holds the mean of three texels

// Where a row of a face begins in a cubemap with a border.
std::size_t inner_row(const CubemapSize& size, std::size_t row) {
  const std::size_t face = row / size.side, down = row % size.side, wide = size.wide();
  return ((face * wide + down + 1) * wide + 1) * TEXEL;
}

// Where a texel that is counted without the border lies in a cubemap that has one.
std::size_t inner_texel(const CubemapSize& size, std::int64_t texel) {
  return inner_row(size, texel / size.side) + texel % size.side * TEXEL;
}

// Calls body(row of all faces) in parallel, `ROWS` at a time.
template <class F>
void for_each_row(const CubemapSize& size, F&& body) {
  constexpr std::size_t ROWS = 32;
  parallel_ranges(static_cast<std::size_t>(FACES) * size.side, ROWS, [&](std::size_t begin, std::size_t end) {
    for (std::size_t row = begin; row < end; row++) body(row);
  });
}

}  // namespace

void cubemap_colors(const CubemapSize& size, const CubemapBorder& border, const float* logits, float* colors) {
  for_each_row(size, [&](std::size_t row) {
    const float* from = logits + row * size.side * 3;
    float* to = colors + inner_row(size, row);
    for (int first = 0; first < size.side; first += LANES) {
      const int count = std::min(size.side - first, LANES);
      float some[4 * LANES];
      const float* texels = from + 3 * first;
      if (count < LANES) {
        std::fill_n(some, 3 * LANES, 0.f);
        std::copy_n(texels, 3 * count, some);
        texels = some;
      }
      Vec r, g, b;
      load_columns(texels, r, g, b);
      float* const place = count < LANES ? some : to + TEXEL * first;
      store_columns(place, sigmoid(r), sigmoid(g), sigmoid(b), Vec(0.f));
      if (count < LANES) std::copy_n(some, TEXEL * count, to + TEXEL * first);
    }
  });
  for (std::size_t i = 0; i < border.count; i++) {
    const float* from[3];
    for (int k = 0; k < 3; k++) from[k] = colors + inner_texel(size, border.sources[3 * i + k]);
    float* to = colors + border.places[i] * TEXEL;
    for (int c = 0; c < TEXEL; c++) to[c] = (from[0][c] + from[1][c] + from[2][c]) * MEETING;
  }
}

void cubemap_gradient(const CubemapSize& size, const CubemapBorder& border, const float* colors, float* shards,
                      float* of_logits) {
  const std::size_t stride = size.floats();
  for (std::size_t i = 0; i < border.count; i++)
    for (int c = 0; c < 3; c++) {
      const float* from = shards + border.places[i] * TEXEL + c;
      float sum = from[0];
      for (int s = 1; s < TEXEL_SHARDS; s++) sum += from[s * stride];
      for (int k = 0; k < 3; k++) shards[inner_texel(size, border.sources[3 * i + k]) + c] += sum * MEETING;
    }
  for_each_row(size, [&](std::size_t row) {
    const std::size_t begin = inner_row(size, row);
    float* to = of_logits + row * size.side * 3;
    for (int first = 0; first < size.side; first += LANES) {
      const int count = std::min(size.side - first, LANES);
      float some[TEXEL * LANES] = {};
      for (int i = 0; i < TEXEL * count; i += LANES) {
        const int left = std::min(TEXEL * count - i, LANES);
        const std::size_t at = begin + TEXEL * first + i;
        Vec total = load_first(shards + at, left);
        for (int s = 1; s < TEXEL_SHARDS; s++) total += load_first(shards + s * stride + at, left);
        const Vec color = load_first(colors + at, left);
        store(some + i, total * color * (Vec(1.f) - color));
      }
      Vec columns[TEXEL];
      load_columns(some, columns[0], columns[1], columns[2], columns[3]);
      float* const place = count < LANES ? some : to + 3 * first;
      store_columns(place, columns[0], columns[1], columns[2]);
      if (count < LANES) std::copy_n(some, 3 * count, to + 3 * first);
    }
  });
}

}  // namespace ringlight::RINGLIGHT_ISA
