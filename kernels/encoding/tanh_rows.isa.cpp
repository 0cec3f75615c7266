#include "encoding/tanh_rows.hpp"

#include "machine/parallel.hpp"
#include "simd/simd.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

constexpr std::size_t ROWS_PER_PIECE = 1024;

// To about 1e-7: 1 - 2 / (1 + e^2x).
RINGLIGHT_INLINE Vec tanh_of(Vec x) { return Vec(1.f) - Vec(2.f) / (Vec(1.f) + exp(x + x)); }

}  // namespace

void tanh_rows(std::size_t count, std::size_t width, const float* values, const std::int32_t* numbers,
               std::size_t stride, float* rows) {
  parallel_ranges(count, ROWS_PER_PIECE, [=](std::size_t begin, std::size_t end) {
    for (std::size_t row = begin; row < end; row++) {
      const float* from = values + (numbers ? static_cast<std::size_t>(numbers[row]) : row) * width;
      float* to = rows + row * stride;
      std::size_t i = 0;
      for (; i + LANES <= width; i += LANES) store(to + i, tanh_of(load(from + i)));
      const int left = static_cast<int>(width - i);
      if (left) store_first(to + i, tanh_of(load_first(from + i, left)), left);
    }
  });
}

}  // namespace ringlight::RINGLIGHT_ISA
