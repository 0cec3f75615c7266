#include "encoding/directional_encoding.hpp"

#include "encoding/lane_codes.isa.hpp"
#include "machine/parallel.hpp"
#include "simd/row_columns.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

constexpr std::size_t ROWS_PER_PIECE = 1024;

}  // namespace

void directional_encoding(std::size_t count, const float* directions, const float* roughness,
                          const float* polynomials, std::size_t stride, float* rows) {
  parallel_ranges(count, ROWS_PER_PIECE, [=](std::size_t begin, std::size_t end) {
    for (std::size_t first = begin; first < end; first += LANES) {
      const int some = end - first < LANES ? static_cast<int>(end - first) : LANES;
      Vec direction[LANES], code[CODE_BLOCKS * LANES];
      take_columns(directions + 3 * first, 3, some, direction);
      encode(direction, load_first(roughness + first, some), polynomials, code);
      for (int block = 0; block < CODE_BLOCKS; block++) {
        const int left = CODE_WIDTH - block * LANES, width = left < LANES ? left : LANES;
        transpose(code + block * LANES);
        for (int i = 0; i < some; i++)
          store_first(rows + (first + i) * stride + block * LANES, code[block * LANES + i], width);
      }
    }
  });
}

}  // namespace ringlight::RINGLIGHT_ISA
