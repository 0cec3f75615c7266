// The sums that a shard of the backward pass keeps, and how the shards become one gradient: added in order, so that
// the result does not depend on who ran them. Include from kernels/isa/*.cpp alone, see simd.hpp.
#pragma once
#include "parallel.hpp"
#include "ring_batch.hpp"

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

// All shards: the sums of the first at `sums`, every `stride` floats the next.
struct Shards {
  const float* sums;
  std::size_t stride;
  int count;
};

constexpr std::size_t SUM_GRAIN = 8192;  // floats a piece

// to[rows][width] = the sum of the shards' [rows][from_width] at `part` of the first.
static inline void add_up_rows(const Shards& shards, const float* part, std::size_t from_width, std::size_t rows,
                               std::size_t width, float* to) {
  parallel_ranges(rows, 1 + SUM_GRAIN / width, [=](std::size_t begin, std::size_t end) {
    for (std::size_t row = begin; row < end; row++)
      for (std::size_t i = 0; i < width; i += LANES) {
        const int left = width - i < LANES ? static_cast<int>(width - i) : LANES;
        const float* from = part + row * from_width + i;
        Vec sum = load_first(from, left);
        for (int shard = 1; shard < shards.count; shard++) sum += load_first(from + shard * shards.stride, left);
        store_first(to + row * width + i, sum, left);
      }
  });
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

static inline void add_up_layer(const Shards& shards, const LayerSums& of_first, const RingLayer<float>& to) {
  add_up_rows(shards, of_first.weight, padded(of_first.inputs), of_first.outputs, of_first.inputs, to.weight);
  if (!of_first.bias) return;
  for (int o = 0; o < of_first.outputs; o++) {
    Vec lanes(0.f);
    for (int shard = 0; shard < shards.count; shard++)
      lanes += load(of_first.bias + shard * shards.stride + o * LANES);
    to.bias[o] = sum(lanes);
  }
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
  add_up_layer(shards, sums.core, {to.core, nullptr});
  for (int layer = 0; layer < 2 && modulated(shape); layer++)
    add_up_layer(shards, sums.modulation[layer], to.modulation[layer]);
  for (int layer = 0; layer < 3; layer++) add_up_layer(shards, sums.render[layer], to.render[layer]);
}

}  // namespace ringlight::RINGLIGHT_ISA
