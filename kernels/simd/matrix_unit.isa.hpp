// The matrix unit of newer Intel processors (AMX): eight tiles of sixteen rows of sixteen words, and a multiply-add of
// tiles. Included by simd.isa.hpp only.
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

// While it lives, this thread may use tiles; one at a time on a thread. Tiles are let go, for a thread that holds some
// takes longer to switch.
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

// Up to four tiles of sums, at the corners of a square of rows and columns: the second row and the second column are
// there only where `Down` and `Right` say so. Strides are from row to row, in floats.
struct TileSums {
  static void clear() {
    _tile_zero(0);
    _tile_zero(1);
    _tile_zero(2);
    _tile_zero(3);
  }
  // A tile's rows, which the address sanitizer, that does not know these instructions, looks at here.
  template <class Float>
  static Float* see(Float* rows, [[maybe_unused]] int stride) {
#ifdef __SANITIZE_ADDRESS__
    for (int row = 0; row < LANES; row++)
      for (int column = 0; column < LANES; column += LANES - 1)
        static_cast<void>(*const_cast<const volatile float*>(rows + row * stride + column));
#endif
    return rows;
  }
  template <bool Down, bool Right>
  static void load(const float* from, int stride) {
    _tile_loadd(0, see(from, stride), stride * 4);
    if constexpr (Right) _tile_loadd(1, see(from + LANES, stride), stride * 4);
    if constexpr (Down) _tile_loadd(2, see(from + LANES * stride, stride), stride * 4);
    if constexpr (Down && Right) _tile_loadd(3, see(from + LANES * stride + LANES, stride), stride * 4);
  }
  template <bool Down, bool Right>
  static void store(float* to, int stride) {
    _tile_stored(0, see(to, stride), stride * 4);
    if constexpr (Right) _tile_stored(1, see(to + LANES, stride), stride * 4);
    if constexpr (Down) _tile_stored(2, see(to + LANES * stride, stride), stride * 4);
    if constexpr (Down && Right) _tile_stored(3, see(to + LANES * stride + LANES, stride), stride * 4);
  }
  // += tiles of sixteen rows of pairs, times tiles of such pairs by sixteen columns; the second tile of each kind lies
  // `next` floats behind the first.
  template <bool Down, bool Right>
  static void add_product(const float* rows, int rows_stride, int next_rows, const float* columns, int columns_stride,
                          int next_columns) {
    _tile_loadd(4, see(rows, rows_stride), rows_stride * 4);
    _tile_loadd(6, see(columns, columns_stride), columns_stride * 4);
    _tile_dpbf16ps(0, 4, 6);
    if constexpr (Right) {
      _tile_loadd(7, see(columns + next_columns, columns_stride), columns_stride * 4);
      _tile_dpbf16ps(1, 4, 7);
    }
    if constexpr (Down) {
      _tile_loadd(5, see(rows + next_rows, rows_stride), rows_stride * 4);
      _tile_dpbf16ps(2, 5, 6);
    }
    if constexpr (Down && Right) _tile_dpbf16ps(3, 5, 7);
  }
};

// Two rows of eight columns in a Vec, see ring/product_pairs.isa.hpp.
struct RowPairs {
  // Both rows pair of columns by pair of columns, from one after the other.
  static Vec left(Vec rows) {
    return _mm512_permutexvar_ps(_mm512_setr_epi32(0, 1, 8, 9, 2, 3, 10, 11, 4, 5, 12, 13, 6, 7, 14, 15), rows.v);
  }
  // The same column by column.
  static Vec right(Vec rows) {
    return _mm512_permutexvar_ps(_mm512_setr_epi32(0, 8, 1, 9, 2, 10, 3, 11, 4, 12, 5, 13, 6, 14, 7, 15), rows.v);
  }
  // Two neighbours in all places.
  static Vec broadcast(const float* pair) {
    double both;
    __builtin_memcpy(&both, pair, sizeof both);
    return _mm512_castpd_ps(_mm512_set1_pd(both));
  }
  // In each quarter the sums of two neighbours: two of the first row, then two of the second.
  static Vec sums(Vec first, Vec second) {
    return _mm512_add_ps(_mm512_shuffle_ps(first.v, second.v, 0x88), _mm512_shuffle_ps(first.v, second.v, 0xdd));
  }
};
#else
constexpr bool HAS_MATRIX_UNIT = false;
struct TileSums {};
struct RowPairs {};
RINGLIGHT_INLINE void before_tile_loads() {}
struct MatrixUnit {
  MatrixUnit() {}
  ~MatrixUnit() {}  // so that nobody calls it unused
};
#endif

}  // namespace ringlight::RINGLIGHT_ISA
