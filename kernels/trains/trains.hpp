// Tensor trains: the eight nodes around points, by their paths, and sums of eight rows. PuTT (Loeschcke et al. 2024).
#pragma once
#include <cstddef>
#include <cstdint>

#include "convention.hpp"
#include "simd/dispatch.hpp"

namespace ringlight {

constexpr int TRAIN_CORNERS = 8;

// Points [N 3] in [0, 1]^3 in a grid of 2^levels nodes a side; node i lies at i / 2^levels. The `first` bits of an axis
// tell blocks apart.
struct TrainPoints {
  const float* places;
  std::size_t count;
  int levels, first;
};

// Of each point eight rows: `index` [N 8] and `shares` [N 8].
template <class Int, class Float>
struct TrainBags {
  Int* index;
  Float* shares;
};

// Bags in the order of their blocks: block b has those from ends[b] to ends[b + 1], and the matrix [outputs width] b.
// A bag is a part of one of `points`, its owner.
struct TrainBlocks {
  TrainBags<const std::int32_t, const float> bags;
  const std::int64_t* ends;
  const std::int32_t* owners;
  std::size_t points;
  std::size_t count;
  const float *matrices, *rows;
  std::size_t outputs, width;
};

#define RINGLIGHT_TRAINS(isa) \
  namespace isa { \
  void train_touch(const TrainPoints&, std::int8_t* touched); \
  void train_corners(const TrainPoints&, const std::int32_t* slots, const TrainBags<std::int32_t, float>&); \
  void train_count(const TrainPoints&, const std::int32_t* slots, std::int64_t* counts); \
  void train_parts(const TrainPoints&, const std::int32_t* slots, std::int64_t* ends, std::int32_t* owners, \
                   const TrainBags<std::int32_t, float>&); \
  void train_gather(const TrainBags<const std::int32_t, const float>&, std::size_t count, std::size_t width, \
                    const float* rows, float* found); \
  void train_scatter(const TrainBags<const std::int32_t, const float>&, std::size_t count, std::size_t width, \
                     const float* gradient, float* rows); \
  void train_products(const TrainBlocks&, float* found); \
  void train_products_gradient(const TrainBlocks&, std::size_t row_count, const float* gradient, \
                               float* grad_matrices, float* grad_rows); \
  }
RINGLIGHT_EVERY_ISA(RINGLIGHT_TRAINS)
#undef RINGLIGHT_TRAINS

}  // namespace ringlight
