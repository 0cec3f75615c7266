// Rows of a table to planar lanes and back, in registers. For files in isa/ only: everything is local to the file.
#pragma once
#include <cstddef>

namespace ringlight::RINGLIGHT_ISA {
namespace {

using Eight = float __attribute__((vector_size(32)));

inline void load(const float* from, Eight& to) { __builtin_memcpy(&to, from, sizeof to); }
inline void store(const Eight& from, float* to) { __builtin_memcpy(to, &from, sizeof from); }

// out[j][i] = in[i][j] for i, j < 8; strides in floats.
inline void transpose8(const float* in, std::ptrdiff_t in_stride, float* out, std::ptrdiff_t out_stride) {
  Eight rows[8], pairs[8], quads[8];
#pragma GCC unroll 8
  for (int i = 0; i < 8; i++) load(in + i * in_stride, rows[i]);
#pragma GCC unroll 4
  for (int i = 0; i < 8; i += 2) {
    pairs[i] = __builtin_shufflevector(rows[i], rows[i + 1], 0, 8, 1, 9, 4, 12, 5, 13);
    pairs[i + 1] = __builtin_shufflevector(rows[i], rows[i + 1], 2, 10, 3, 11, 6, 14, 7, 15);
  }
#pragma GCC unroll 4
  for (int i = 0; i < 8; i += 4)
#pragma GCC unroll 2
    for (int j = 0; j < 2; j++) {
      quads[i + 2 * j] = __builtin_shufflevector(pairs[i + j], pairs[i + j + 2], 0, 1, 8, 9, 4, 5, 12, 13);
      quads[i + 2 * j + 1] = __builtin_shufflevector(pairs[i + j], pairs[i + j + 2], 2, 3, 10, 11, 6, 7, 14, 15);
    }
#pragma GCC unroll 4
  for (int i = 0; i < 4; i++) {
    store(__builtin_shufflevector(quads[i], quads[i + 4], 0, 1, 2, 3, 8, 9, 10, 11), out + i * out_stride);
    store(__builtin_shufflevector(quads[i], quads[i + 4], 4, 5, 6, 7, 12, 13, 14, 15), out + (i + 4) * out_stride);
  }
}

// First column of the 8 x 8 piece that begins at `column`: the last piece is pulled back so that it ends at
// `columns`, and repeats some work instead of touching the next row.
inline int piece_start(int column, int columns) { return column + 8 <= columns ? column : columns - 8; }

// planar[j][lane] = rows[lane][j] for 16 rows and at least 8 columns.
inline void transpose(const float* rows, std::ptrdiff_t row_stride, float* planar, std::ptrdiff_t planar_stride,
                      int columns) {
  for (int column = 0; column < columns; column += 8) {
    const int start = piece_start(column, columns);
    for (int half = 0; half < 16; half += 8)
      transpose8(rows + half * row_stride + start, row_stride, planar + start * planar_stride + half, planar_stride);
  }
}

// rows[lane][j] = planar[j][lane].
inline void transpose_back(const float* planar, std::ptrdiff_t planar_stride, float* rows, std::ptrdiff_t row_stride,
                           int columns) {
  for (int half = 0; half < 16; half += 8)
    for (int column = 0; column < columns; column += 8) {
      const int start = piece_start(column, columns);
      transpose8(planar + start * planar_stride + half, planar_stride, rows + half * row_stride + start, row_stride);
    }
}

}  // namespace
}  // namespace ringlight::RINGLIGHT_ISA
