// A perceptron of three layers for a group of rows, one per lane, and the way back: what the stack of the ring's heads
// and the light of 3iGS share.
#pragma once
#include "dense/group_rows.isa.hpp"
#include "dense/lane_layers.isa.hpp"
#include "dense/perceptron.hpp"
#include "machine/parallel.hpp"
#include "machine/scratch.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {  // a lambda of an inline constructor would be shared by object files otherwise

constexpr int LAYERS = 3;

struct Widths {
  int of[LAYERS + 1];  // inputs, hidden, hidden, outputs
  int widest;  // rows to allow for in a group

  explicit Widths(const PerceptronShape& shape) : of{shape.inputs, shape.hidden, shape.hidden, shape.outputs} {
    widest = 0;
    for (const int width : of) widest = width > widest ? width : widest;
    widest = result_rows(widest);
  }
  // Floats of a packed layer, transposed or not, and of all.
  std::size_t weights(int layer) const {
    const int inputs = of[layer], outputs = of[layer + 1];
    const std::size_t plain = panel_floats<LayerTerms>(outputs, inputs);
    const std::size_t transposed = panel_floats<LayerTerms>(inputs, outputs);
    return plain > transposed ? plain : transposed;
  }
  std::size_t weights() const { return weights(0) + weights(1) + weights(2); }
};

// One head's layers, reordered.
struct HeadPanels {
  Panels layers[LAYERS];
};

// All heads' layers; the transposed ones map the gradient of a layer's result to that of its input.
struct StackPanels {
  Widths widths;
  PerceptronLayers<const float> layers;
  Scratch memory;
  int heads;

  StackPanels(const PerceptronShape& shape, const PerceptronLayers<const float>& from, bool with_transposed)
      : widths(shape),
        layers(from),
        memory(widths.weights() * shape.heads * (1 + with_transposed) * sizeof(float)),
        heads(shape.heads) {
    parallel_for(static_cast<std::size_t>(heads) * (1 + with_transposed), [this](std::size_t piece) {
      walk(static_cast<int>(piece) % heads, static_cast<int>(piece) >= heads, true);
    });
  }
  HeadPanels of(int head, bool transposed) const { return walk(head, transposed, false); }

 private:
  HeadPanels walk(int head, bool transposed, bool write) const {
    HeadPanels panels;
    float* to = memory.floats() + widths.weights() * (head + (transposed ? heads : 0));
    for (int layer = 0; layer < LAYERS; layer++) {
      const int inputs = widths.of[layer], outputs = widths.of[layer + 1];
      const float* weight = layers.weight[layer] + static_cast<std::size_t>(head) * inputs * outputs;
      const float* bias = layers.bias[layer] + head * outputs;
      panels.layers[layer] = transposed ? Panels{to, nullptr, inputs, outputs} : Panels{to, bias, outputs, inputs};
      if (write && transposed) pack<LayerTerms>(weight, outputs, 1, nullptr, inputs, outputs, to);
      if (write && !transposed) pack<LayerTerms>(weight, 1, outputs, bias, outputs, inputs, to);
      to += widths.weights(layer);
    }
    return panels;
  }
};

// What each layer is given, and the last one's result: [width][GROUP]; and room for a layer's input as terms.
struct Activations {
  float *of[LAYERS + 1], *terms;
};

template <Result Kind>
static void evaluate(const HeadPanels& panels, const Activations& at, int layer) {
  const Panels& packed = panels.layers[layer];
  dense<LayerTerms, Kind>(packed, feature_terms<LayerTerms>(at.of[layer], packed.inputs, at.terms), at.of[layer + 1]);
}

static inline void evaluate_hidden(const HeadPanels& panels, const Activations& at) {
  for (int layer = 0; layer + 1 < LAYERS; layer++) evaluate<Result::RECTIFIED>(panels, at, layer);
}

static inline Activations lay_out(const Widths& widths, float* memory) {
  Activations at;
  const std::size_t block = static_cast<std::size_t>(widths.widest) * GROUP;
  for (int i = 0; i <= LAYERS; i++) at.of[i] = memory + i * block;
  at.terms = memory + (LAYERS + 1) * block;
  return at;
}
constexpr int SPARE = LAYERS + 2;  // blocks of [widest][GROUP] that Activations take

// Sums of a shard: weight_sums(inputs, outputs), then bias [outputs][16], layer after layer.
static inline std::size_t sums_size(const Widths& widths) {
  std::size_t size = 0;
  for (int layer = 0; layer < LAYERS; layer++)
    size += weight_sums(widths.of[layer], widths.of[layer + 1]) + widths.of[layer + 1] * LANES;
  return size;
}

// Adds one group's gradients; on entry gradient.of[LAYERS] is dL/dresult, on return gradient.of[0] that of the rows,
// if it is wanted. Weights are stored [inputs outputs], so the roles of add_layer_gradient are swapped: the layer's
// input is broadcast, the gradient is turned into rows.
static inline void add_gradients(const Widths& widths, const HeadPanels& transposed, const Activations& at,
                                 const Activations& gradient, bool with_rows, float* blocks, float* sums) {
  float* ends = sums + sums_size(widths);
  for (int layer = LAYERS - 1; layer >= 0; layer--) {
    const int inputs = widths.of[layer], outputs = widths.of[layer + 1];
    ends -= weight_sums(inputs, outputs) + outputs * LANES;
    to_rows<LayerTerms>(gradient.of[layer + 1], outputs, blocks);
    add_layer_gradient<LayerTerms>({ends, nullptr, inputs, outputs}, at.of[layer], blocks, at.terms);
    float* bias = ends + weight_sums(inputs, outputs);
    for (int o = 0; o < outputs; o++) {
      const float* of_output = gradient.of[layer + 1] + o * GROUP;
      store(bias + o * LANES, load(bias + o * LANES) + load(of_output) + load(of_output + LANES));
    }
    if (layer == 0 && !with_rows) return;
    const float* terms = feature_terms<LayerTerms>(gradient.of[layer + 1], outputs, at.terms);
    dense<LayerTerms>(transposed.layers[layer], terms, gradient.of[layer]);
    if (layer > 0) rectify_gradient(gradient.of[layer], at.of[layer], inputs);
  }
}

// Adds up the shards of one head, in order; they lie `stride` floats apart.
static inline void write_gradients(const Widths& widths, const float* sums, std::size_t stride, int shards, int head,
                                   const PerceptronLayers<float>& gradients) {
  for (int layer = 0; layer < LAYERS; layer++) {
    const int inputs = widths.of[layer], outputs = widths.of[layer + 1], width = padded(outputs);
    float* weight = gradients.weight[layer] + static_cast<std::size_t>(head) * inputs * outputs;
    for (int i = 0; i < inputs; i++)
      for (int o = 0; o < outputs; o += LANES) {
        const int left = outputs - o < LANES ? outputs - o : LANES;
        Vec total(0.f);
        for (int shard = 0; shard < shards; shard++) total += load(sums + shard * stride + i * width + o);
        store_first(weight + static_cast<std::size_t>(i) * outputs + o, total, left);
      }
    sums += weight_sums(inputs, outputs);
    for (int o = 0; o < outputs; o++) {
      Vec total(0.f);
      for (int shard = 0; shard < shards; shard++) total += load(sums + shard * stride + o * LANES);
      gradients.bias[layer][head * outputs + o] = sum(total);
    }
    sums += outputs * LANES;
  }
}

}  // namespace
}  // namespace ringlight::RINGLIGHT_ISA
