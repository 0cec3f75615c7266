// A backward pass is dealt to a fixed number of shards, each with sums of its own, which are added in order: the
// result does not depend on who ran them.
#pragma once
#include "dense/lane_layers.isa.hpp"
#include "machine/parallel.hpp"

namespace ringlight::RINGLIGHT_ISA {

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

// A layer's gradient; `bias` is not touched where the layer has none.
static inline void add_up_layer(const Shards& shards, const LayerSums& of_first, float* weight, float* bias) {
  add_up_rows(shards, of_first.weight, padded(of_first.inputs), of_first.outputs, of_first.inputs, weight);
  if (!of_first.bias) return;
  for (int o = 0; o < of_first.outputs; o++) {
    Vec lanes(0.f);
    for (int shard = 0; shard < shards.count; shard++)
      lanes += load(of_first.bias + shard * shards.stride + o * LANES);
    bias[o] = sum(lanes);
  }
}

}  // namespace ringlight::RINGLIGHT_ISA
