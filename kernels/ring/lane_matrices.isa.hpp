// Products of small square matrices, sixteen at a time: element (i, j) of a matrix is a Vec over sixteen Gaussians.
#pragma once
#include "dense/lane_layers.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

// Element (i, j) lies at values + i * row + j * column; swapping the two transposes.
template <class Float>
struct LaneMatrix {
  Float* values;
  int row, column;

  LaneMatrix transposed() const { return {values, column, row}; }
};

// Rows and columns of the result whose sums stay in registers.
constexpr int TILE_ROWS = 4, TILE_COLUMNS = MANY_REGISTERS ? 4 : 1;

template <int Rows, int Columns>
static inline void product_tile(int rank, LaneMatrix<const float> a, LaneMatrix<const float> b, LaneMatrix<float> c) {
  Vec sums[Rows][Columns];
#pragma GCC unroll 4
  for (int i = 0; i < Rows; i++)
#pragma GCC unroll 4
    for (int j = 0; j < Columns; j++) sums[i][j] = Vec(0.f);
  for (int k = 0; k < rank; k++) {
    Vec right[Columns];
#pragma GCC unroll 4
    for (int j = 0; j < Columns; j++) right[j] = load(b.values + k * b.row + j * b.column);
#pragma GCC unroll 4
    for (int i = 0; i < Rows; i++) {
      const Vec left = load(a.values + i * a.row + k * a.column);
#pragma GCC unroll 4
      for (int j = 0; j < Columns; j++) sums[i][j] = fma(left, right[j], sums[i][j]);
    }
  }
#pragma GCC unroll 4
  for (int i = 0; i < Rows; i++)
#pragma GCC unroll 4
    for (int j = 0; j < Columns; j++) store(c.values + i * c.row + j * c.column, sums[i][j]);
}

template <int Rows>
static inline void product_rows(int rank, LaneMatrix<const float> a, LaneMatrix<const float> b, LaneMatrix<float> c) {
  int j = 0;
  for (; j + TILE_COLUMNS <= rank; j += TILE_COLUMNS) {
    product_tile<Rows, TILE_COLUMNS>(rank, a, b, c);
    b.values += TILE_COLUMNS * b.column, c.values += TILE_COLUMNS * c.column;
  }
  for (; j < rank; j++, b.values += b.column, c.values += c.column) product_tile<Rows, 1>(rank, a, b, c);
}

// c = a b; c must not overlap a or b.
static inline void product(int rank, LaneMatrix<const float> a, LaneMatrix<const float> b, LaneMatrix<float> c) {
  int i = 0;
  for (; i + TILE_ROWS <= rank; i += TILE_ROWS) {
    product_rows<TILE_ROWS>(rank, a, b, c);
    a.values += TILE_ROWS * a.row, c.values += TILE_ROWS * c.row;
  }
  for (; i < rank; i++, a.values += a.row, c.values += c.row) product_rows<1>(rank, a, b, c);
}

}  // namespace ringlight::RINGLIGHT_ISA
