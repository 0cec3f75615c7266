#include "dense/perceptron.hpp"

#include <cstring>

#include "dense/perceptron_layers.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

constexpr int SHARD = 8 * GROUP;  // nodes whose gradients are summed together: a fixed share, for the same bits

}  // namespace

void perceptron_forward(const PerceptronShape& shape, const PerceptronLayers<const float>& layers, const float* rows,
                        float* results) {
  const StackPanels packed(shape, layers, false);
  const Widths& widths = packed.widths;
  const int shards = (shape.nodes + SHARD - 1) / SHARD;
  parallel_for(static_cast<std::size_t>(shape.heads) * shards, [&](std::size_t piece) {
    const int head = static_cast<int>(piece) / shards, begin = static_cast<int>(piece) % shards * SHARD;
    const Scratch memory(static_cast<std::size_t>(SPARE + 1) * (widths.widest + LANES) * GROUP * sizeof(float));
    const MatrixUnit unit;
    const HeadPanels panels = packed.of(head, false);
    const Activations at = lay_out(widths, memory.floats());
    float* blocks = memory.floats() + static_cast<std::size_t>(SPARE) * widths.widest * GROUP;
    for (int node = begin; node < begin + SHARD && node < shape.nodes; node += GROUP) {
      const int count = shape.nodes - node < GROUP ? shape.nodes - node : GROUP;
      const std::size_t row = static_cast<std::size_t>(head) * shape.nodes + node;
      rows_to_lanes(rows + row * shape.inputs, count, shape.inputs, at.of[0]);
      evaluate_hidden(panels, at);
      evaluate<Result::PLAIN>(panels, at, LAYERS - 1);
      lanes_to_rows(at.of[LAYERS], count, shape.outputs, blocks, results + row * shape.outputs);
    }
  });
}

void perceptron_backward(const PerceptronShape& shape, const PerceptronLayers<const float>& layers, const float* rows,
                         const float* upstream, const PerceptronLayers<float>& gradients, float* of_rows) {
  const StackPanels packed(shape, layers, true);
  const Widths& widths = packed.widths;
  const int shards = (shape.nodes + SHARD - 1) / SHARD;
  const std::size_t size = sums_size(widths);
  const Scratch sums(size * shape.heads * shards * sizeof(float));
  parallel_for(static_cast<std::size_t>(shape.heads) * shards, [&](std::size_t piece) {
    const int head = static_cast<int>(piece) / shards, begin = static_cast<int>(piece) % shards * SHARD;
    const Scratch memory(static_cast<std::size_t>(2 * SPARE + 1) * (widths.widest + LANES) * GROUP * sizeof(float));
    const MatrixUnit unit;
    const HeadPanels panels = packed.of(head, false), transposed = packed.of(head, true);
    const std::size_t half = static_cast<std::size_t>(SPARE) * widths.widest * GROUP;
    const Activations at = lay_out(widths, memory.floats()), gradient = lay_out(widths, memory.floats() + half);
    float* own = sums.floats() + piece * size;
    std::memset(own, 0, size * sizeof(float));
    for (int node = begin; node < begin + SHARD && node < shape.nodes; node += GROUP) {
      const int count = shape.nodes - node < GROUP ? shape.nodes - node : GROUP;
      const std::size_t row = static_cast<std::size_t>(head) * shape.nodes + node;
      rows_to_lanes(rows + row * shape.inputs, count, shape.inputs, at.of[0]);
      rows_to_lanes(upstream + row * shape.outputs, count, shape.outputs, gradient.of[LAYERS]);
      evaluate_hidden(panels, at);
      float* blocks = memory.floats() + 2 * half;
      add_gradients(widths, transposed, at, gradient, of_rows != nullptr, blocks, own);
      if (of_rows != nullptr)
        lanes_to_rows(gradient.of[0], count, shape.inputs, blocks, of_rows + row * shape.inputs);
    }
  });
  parallel_for(shape.heads, [&](std::size_t head) {
    const float* of_head = sums.floats() + head * shards * size;
    write_gradients(widths, of_head, size, shards, static_cast<int>(head), gradients);
  });
}

}  // namespace ringlight::RINGLIGHT_ISA
