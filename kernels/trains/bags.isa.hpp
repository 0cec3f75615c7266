// Sums of eight rows each, times their shares.
#pragma once
#include "simd/simd.isa.hpp"
#include "trains/trains.hpp"

namespace ringlight::RINGLIGHT_ISA {

using Bags = TrainBags<const std::int32_t, const float>;

template <int Vecs>
RINGLIGHT_INLINE void sum_columns(const float* rows, std::size_t width, const std::int32_t* index, const float* shares,
                                  float* found) {
  Vec sums[Vecs];
#pragma GCC unroll 4
  for (int v = 0; v < Vecs; v++) sums[v] = Vec(0.f);
  for (int k = 0; k < TRAIN_CORNERS; k++) {
    const float* row = rows + static_cast<std::size_t>(index[k]) * width;
#pragma GCC unroll 4
    for (int v = 0; v < Vecs; v++) sums[v] = fma(Vec(shares[k]), load(row + v * LANES), sums[v]);
  }
#pragma GCC unroll 4
  for (int v = 0; v < Vecs; v++) store(found + v * LANES, sums[v]);
}

static inline void sum_last_columns(const float* rows, std::size_t width, int left, const std::int32_t* index,
                                    const float* shares, float* found) {
  Vec sum(0.f);
  for (int k = 0; k < TRAIN_CORNERS; k++)
    sum = fma(Vec(shares[k]), load_first(rows + static_cast<std::size_t>(index[k]) * width, left), sum);
  store_first(found, sum, left);
}

// Of one bag, all columns.
static inline void sum_rows(const Bags& bags, std::size_t bag, std::size_t width, const float* rows, float* found) {
  const std::int32_t* index = bags.index + TRAIN_CORNERS * bag;
  const float* shares = bags.shares + TRAIN_CORNERS * bag;
  std::size_t column = 0;
  for (; column + 4 * LANES <= width; column += 4 * LANES)
    sum_columns<4>(rows + column, width, index, shares, found + column);
  for (; column + LANES <= width; column += LANES)
    sum_columns<1>(rows + column, width, index, shares, found + column);
  if (column < width)
    sum_last_columns(rows + column, width, static_cast<int>(width - column), index, shares, found + column);
}

// Adds one bag's gradient, of all columns, to its rows.
static inline void add_rows(const Bags& bags, std::size_t bag, std::size_t width, const float* gradient, float* rows) {
  for (int k = 0; k < TRAIN_CORNERS; k++) {
    const float share = bags.shares[TRAIN_CORNERS * bag + k];
    if (share == 0.f) continue;
    float* row = rows + static_cast<std::size_t>(bags.index[TRAIN_CORNERS * bag + k]) * width;
    std::size_t column = 0;
    for (; column + LANES <= width; column += LANES)
      store(row + column, fma(Vec(share), load(gradient + column), load(row + column)));
    if (column == width) continue;
    const int left = static_cast<int>(width - column);
    const Vec sum = fma(Vec(share), load_first(gradient + column, left), load_first(row + column, left));
    store_first(row + column, sum, left);
  }
}

}  // namespace ringlight::RINGLIGHT_ISA
