// The sums that a shard of the light field's backward pass keeps, and how the shards become one gradient.
// Include from kernels/isa/*.cpp alone, see simd.hpp.
#pragma once
#include "ring_batch.hpp"
#include "shard_sums.hpp"

namespace ringlight::RINGLIGHT_ISA {

// One shard's sums, in the layout of its part of the workspace.
struct ShardSums {
  float *axes, *view;  // as the tables, but each matrix of an axis is transposed if the ring is evaluated by rows
  LayerSums core, modulation[2], render[3];
};

static inline ShardSums lay_out_sums(const RingShape& shape, Arena& arena) {
  const auto layer = [&](int outputs, int inputs, bool biased) {
    LayerSums sums{nullptr, nullptr, outputs, inputs};
    sums.weight = arena.take(static_cast<std::size_t>(outputs) * padded(inputs));
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

static inline void add_up_shards(const RingShape& shape, const Shards& shards, const RingParameters<float>& to) {
  Arena first{const_cast<float*>(shards.sums)};
  const ShardSums sums = lay_out_sums(shape, first);
  const std::size_t matrix = matrix_size(shape);
  const std::size_t nodes = 3 * static_cast<std::size_t>(shape.nodes);
  if (by_rows(shape))
    add_up_transposed(shards, sums.axes, nodes, to.axes);
  else
    add_up_rows(shards, sums.axes, matrix, nodes, matrix, to.axes);
  add_up_rows(shards, sums.view, matrix, view_size(shape) / matrix, matrix, to.view);
  add_up_layer(shards, sums.core, to.core, nullptr);
  for (int layer = 0; layer < 2 && modulated(shape); layer++)
    add_up_layer(shards, sums.modulation[layer], to.modulation[layer].weight, to.modulation[layer].bias);
  for (int layer = 0; layer < 3; layer++)
    add_up_layer(shards, sums.render[layer], to.render[layer].weight, to.render[layer].bias);
}

}  // namespace ringlight::RINGLIGHT_ISA
