// The sums that a shard of the light field's backward pass keeps, and how the shards become one gradient.
#pragma once
#include "dense/shard_sums.isa.hpp"
#include "ring/batch.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

// One shard's sums, in the layout of its part of the workspace.
struct ShardSums {
  // As the tables, but each matrix of an axis is transposed if the ring is evaluated by rows, and all of them, the
  // core's too, lie tile after tile if it is in tiles.
  float *axes, *view;
  LayerSums core, modulation[2], render[3];
};

static inline ShardSums lay_out_sums(const RingShape& shape, Arena& arena) {
  const auto layer = [&](int outputs, int inputs, bool biased) {
    LayerSums sums{nullptr, nullptr, outputs, inputs};
    sums.weight = arena.take(weight_sums(outputs, inputs));
    if (biased) sums.bias = arena.take(static_cast<std::size_t>(outputs) * LANES);
    return sums;
  };
  const int hidden = shape.render_hidden;
  ShardSums sums;
  sums.axes = arena.take(3 * axis_size(shape));
  sums.view = arena.take(view_size(shape));
  sums.core = layer(shape.features, static_cast<int>(matrix_size(shape)), false);
  if (modulated(shape)) {
    sums.modulation[0] = layer(shape.modulation_hidden, modulation_inputs(shape), true);
    sums.modulation[1] = layer(1, shape.modulation_hidden, true);
  }
  sums.render[0] = layer(hidden, render_inputs(shape), true);
  sums.render[1] = layer(hidden, hidden, true);
  sums.render[2] = layer(3, hidden, true);
  return sums;
}

// to[matrices][MATRIX] = the sum of the shards' matrices, each transposed.
static inline void add_up_transposed(const Shards& shards, const float* part, std::size_t matrices, float* to) {
  parallel_ranges(matrices, SUM_GRAIN / MATRIX, [=](std::size_t begin, std::size_t end) {
    for (std::size_t at = begin * MATRIX; at < end * MATRIX; at += MATRIX) {
      Vec square[LANES];
      for (int row = 0; row < LANES; row++) {
        const float* from = part + at + row * LANES;
        square[row] = load(from);
        for (int shard = 1; shard < shards.count; shard++) square[row] += load(from + shard * shards.stride);
      }
      transpose(square);
      for (int row = 0; row < LANES; row++) store(to + at + row * LANES, square[row]);
    }
  });
}

// to[matrices][R^2] = the sum of the shards' matrices, rows first, which lie tile after tile.
template <class Terms>
static inline void add_up_tiles(const Shards& shards, const float* part, std::size_t matrices, int rank, float* to) {
  if constexpr (numbers_of<Terms> == 2) {
    const int width = rank * rank;
    parallel_ranges(matrices, 1 + SUM_GRAIN / width, [=](std::size_t begin, std::size_t end) {
      for (std::size_t at = begin * width; at < end * width; at += width)
        for (int h = 0; h < rank; h += TILE)
          for (int c = 0; c < rank; c += TILE) {
            const float* from = part + at + h * rank + c * TILE;
            Vec sum = load(from);
            for (int shard = 1; shard < shards.count; shard++) sum += load(from + shard * shards.stride);
            Terms::store_quarters(to + at + h * rank + c, rank, sum);
          }
    });
  }
}

static inline void add_up_shards(const RingShape& shape, const Shards& shards, const RingParameters<float>& to) {
  Arena first{const_cast<float*>(shards.sums)};
  const ShardSums sums = lay_out_sums(shape, first);
  const std::size_t matrix = matrix_size(shape);
  const std::size_t nodes = 3 * static_cast<std::size_t>(shape.nodes);
  if (in_tiles<MatrixTerms>(shape)) {
    add_up_tiles<MatrixTerms>(shards, sums.axes, nodes, shape.rank, to.axes);
    add_up_tiles<MatrixTerms>(shards, sums.view, view_size(shape) / matrix, shape.rank, to.view);
    add_up_tiles<MatrixTerms>(shards, sums.core.weight, shape.features, shape.rank, to.core);
  } else {
    if (by_rows(shape))
      add_up_transposed(shards, sums.axes, nodes, to.axes);
    else
      add_up_rows(shards, sums.axes, matrix, nodes, matrix, to.axes);
    add_up_rows(shards, sums.view, matrix, view_size(shape) / matrix, matrix, to.view);
    add_up_layer(shards, sums.core, to.core, nullptr);
  }
  for (int layer = 0; layer < 2 && modulated(shape); layer++)
    add_up_layer(shards, sums.modulation[layer], to.modulation[layer].weight, to.modulation[layer].bias);
  for (int layer = 0; layer < 3; layer++)
    add_up_layer(shards, sums.render[layer], to.render[layer].weight, to.render[layer].bias);
}

}  // namespace ringlight::RINGLIGHT_ISA
