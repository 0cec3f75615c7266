// The matrix unit of newer Intel processors (AMX): eight tiles of sixteen rows of sixteen words, and a multiply-add of
// tiles. Included by simd.hpp only.
#pragma once

namespace ringlight::RINGLIGHT_ISA {

#ifdef __AMX_BF16__
constexpr bool HAS_MATRIX_UNIT = true;

// As the processor reads it.
struct TileShapes {
  std::uint8_t palette = 1, start_row = 0, reserved[14] = {};
  std::uint16_t row_bytes[16] = {64, 64, 64, 64, 64, 64, 64, 64};
  std::uint8_t rows[16] = {16, 16, 16, 16, 16, 16, 16, 16};
};
alignas(64) static constexpr TileShapes WHOLE_TILES;

// While it lives, this thread may use tiles. They are let go, for a thread that holds some takes longer to switch.
class MatrixUnit {
 public:
  MatrixUnit() { _tile_loadconfig(&WHOLE_TILES); }
  ~MatrixUnit() { _tile_release(); }
  MatrixUnit(const MatrixUnit&) = delete;
  MatrixUnit& operator=(const MatrixUnit&) = delete;
};

// To be called after memory was written in the usual way and before tiles are loaded from it: GCC does not know that
// they are.
RINGLIGHT_INLINE void before_tile_loads() { asm volatile("" ::: "memory"); }

// Tiles 0 to 3 += two tiles of sixteen outputs by sixteen pairs, times two of sixteen pairs by sixteen lanes: tile
// 2 m + n is that of outputs m and lanes n. Strides are from row to row, in floats.
template <bool Two>
RINGLIGHT_INLINE void multiply_tiles_into_sums(const float* first, const float* second, int stride, const float* pairs,
                                               const float* more_pairs, int pairs_stride) {
  _tile_loadd(4, first, stride * 4);
  _tile_loadd(6, pairs, pairs_stride * 4);
  _tile_loadd(7, more_pairs, pairs_stride * 4);
  _tile_dpbf16ps(0, 4, 6);
  _tile_dpbf16ps(1, 4, 7);
  if constexpr (Two) {
    _tile_loadd(5, second, stride * 4);
    _tile_dpbf16ps(2, 5, 6);
    _tile_dpbf16ps(3, 5, 7);
  }
}
#else
constexpr bool HAS_MATRIX_UNIT = false;
struct MatrixUnit {
  MatrixUnit() {}
  ~MatrixUnit() {}  // so that nobody calls it unused
};
#endif

}  // namespace ringlight::RINGLIGHT_ISA
