#include <cstring>

#include "dense/group_rows.isa.hpp"
#include "dense/lane_layers.isa.hpp"
#include "dense/shard_sums.isa.hpp"
#include "machine/parallel.hpp"
#include "machine/scratch.isa.hpp"
#include "volume/factors.isa.hpp"
#include "volume/waves.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

constexpr int LAYERS = 3, COLORS = 3, DIRECTION = 3, FREQUENCIES = convention::VOLUME_FREQUENCIES;
constexpr std::size_t PIECE = 8 * GROUP;  // rows that are shaded together
constexpr int SHARDS = 16;                // of rows, whose gradients are summed by themselves

// Inputs of the network: features, direction, sines and cosines of the features, then of the direction. Features that
// are given have no components.
struct Widths {
  int components, features, of[LAYERS + 1], widest;

  Widths(const VolumeShape& shape, const VolumeSeen& seen)
      : components(seen.features ? 0 : seen.factors.width()),
        features(shape.features),
        of{(shape.features + DIRECTION) * (1 + 2 * FREQUENCIES), shape.hidden, shape.hidden, COLORS} {
    widest = components;
    for (const int width : of) widest = width > widest ? width : widest;
    widest = result_rows(widest);
  }
};

// The basis, then the layers, in the order of use; transposed ones map gradients of results to those of inputs.
template <class Terms>
struct NetworkPanels {
  Widths widths;
  Scratch memory;
  Panels basis, layers[LAYERS], basis_back, layers_back[LAYERS];

  NetworkPanels(const Widths& of, const VolumeNetwork<const float>& network, bool with_back)
      : widths(of), memory(size(of) * sizeof(float)) {
    float* to = memory.floats();
    const int components = of.components, features = of.features;
    if (components) {
      basis = pack<Vec>(network.basis, components, 1, nullptr, features, components, to);
      to += panel_floats<Vec>(features, components);
    }
    if (components && with_back) {
      basis_back = pack<Vec>(network.basis, 1, components, nullptr, components, features, to);
      to += panel_floats<Vec>(components, features);
    }
    for (int layer = 0; layer < LAYERS; layer++) {
      const int inputs = of.of[layer], outputs = of.of[layer + 1];
      const float* weight = network.weights[layer];
      layers[layer] = pack<Terms>(weight, inputs, 1, network.biases[layer], outputs, inputs, to);
      to += panel_floats<Terms>(outputs, inputs);
      if (!with_back) continue;
      layers_back[layer] = pack<Terms>(weight, 1, inputs, nullptr, inputs, outputs, to);
      to += panel_floats<Terms>(inputs, outputs);
    }
  }

 private:
  static std::size_t size(const Widths& of) {
    std::size_t total = 2 * static_cast<std::size_t>(padded(of.features)) * padded(of.components);
    for (int layer = 0; layer < LAYERS; layer++)
      total += 2 * static_cast<std::size_t>(padded(of.of[layer])) * padded(of.of[layer + 1]);
    return total;
  }
};

// One group: [width][GROUP] each.
struct Group {
  float *components, *at[LAYERS + 1], *terms, *rows;

  static constexpr int BLOCKS = LAYERS + 4;

  Group(float* memory, const Widths& widths) {
    const std::size_t block = static_cast<std::size_t>(padded(widths.widest)) * GROUP;
    components = memory;
    for (int i = 0; i <= LAYERS; i++) at[i] = memory + (1 + i) * block;
    terms = memory + (LAYERS + 2) * block;
    rows = memory + (LAYERS + 3) * block;
  }
  static std::size_t size(const Widths& widths) {
    return static_cast<std::size_t>(BLOCKS) * padded(widths.widest) * GROUP;
  }
};

// The features of `count` rows, at the begin of the network's input, and their components.
template <class Terms>
void look_up(const NetworkPanels<Terms>& panels, const VolumeSeen& seen, std::size_t first, int count,
             const Group& group) {
  const Widths& widths = panels.widths;
  if (seen.features) {
    rows_to_lanes(seen.features + first * widths.features, count, widths.features, group.at[0]);
    return;
  }
  for (int i = 0; i < count; i++) {
    const float* place = seen.places + 3 * static_cast<std::size_t>(seen.samples[first + i]);
    components_at(seen.factors, place, group.rows + static_cast<std::size_t>(i) * widths.components);
  }
  rows_to_lanes(group.rows, count, widths.components, group.components);
  dense<Vec>(panels.basis, group.components, group.at[0]);
}

// What `count` rows of the network see.
template <class Terms>
void look(const NetworkPanels<Terms>& panels, const VolumeSeen& seen, const VolumeRows& rows, std::size_t first,
          int count, const float* directions, const Group& group) {
  const Widths& widths = panels.widths;
  look_up(panels, seen, first, count, group);
  float *features = group.at[0], *direction = features + widths.features * GROUP;
  for (int i = 0; i < GROUP; i++)
    for (int axis = 0; axis < DIRECTION; axis++)
      direction[axis * GROUP + i] = i < count ? directions[3 * static_cast<std::size_t>(rows.rays[first + i]) + axis]
                                              : 0.f;
  // Of a number x: sin x, sin 2x, cos x, cos 2x, `apart` rows from each other.
  const auto waves = [](const float* from, float* to, int numbers) {
    const std::size_t apart = static_cast<std::size_t>(numbers) * GROUP;
    for (std::size_t i = 0; i < apart; i += LANES) {
      const Wave once = wave(load(from + i));
      store(to + i, once.sine);
      store(to + apart + i, (once.sine + once.sine) * once.cosine);
      store(to + 2 * apart + i, once.cosine);
      store(to + 3 * apart + i, fnma(once.sine + once.sine, once.sine, Vec(1.f)));
    }
  };
  float* of_features = direction + DIRECTION * GROUP;
  waves(features, of_features, widths.features);
  waves(direction, of_features + 2 * FREQUENCIES * widths.features * GROUP, DIRECTION);
}

// The layers from `first` on.
template <class Terms>
void evaluate(const NetworkPanels<Terms>& panels, const Group& group, int first) {
  for (int layer = first; layer < LAYERS; layer++) {
    const Panels& packed = panels.layers[layer];
    const float* x = feature_terms<Terms>(group.at[layer], packed.inputs, group.terms);
    if (layer + 1 < LAYERS)
      dense<Terms, Result::RECTIFIED>(packed, x, group.at[layer + 1]);
    else
      dense<Terms, Result::PLAIN>(packed, x, group.at[layer + 1]);
  }
  for (int i = 0; i < COLORS * GROUP; i += LANES) store(group.at[LAYERS] + i, sigmoid(load(group.at[LAYERS] + i)));
}

// Where the units that go into `layer` are kept, of the group that begins with row `first`.
template <class Float>
Float* kept(Float* hidden, const VolumeShape& shape, std::size_t rows, std::size_t first, int layer) {
  return hidden + ((layer - 1) * rows + first) * shape.hidden;
}

template <class Terms>
void shade_rows(const VolumeShape& shape, const VolumeSeen& seen, const VolumeNetwork<const float>& network,
                const VolumeRows& rows, const float* directions, float* colors, float* hidden) {
  const NetworkPanels<Terms> panels(Widths(shape, seen), network, false);
  parallel_ranges(rows.count, PIECE, [&](std::size_t begin, std::size_t end) {
    const Scratch memory(Group::size(panels.widths) * sizeof(float));
    const MatrixUnit unit;
    const Group group(memory.floats(), panels.widths);
    for (std::size_t first = begin; first < end; first += GROUP) {
      const int count = end - first < GROUP ? static_cast<int>(end - first) : GROUP;
      look(panels, seen, rows, first, count, directions, group);
      evaluate(panels, group, 0);
      for (int layer = 1; hidden && layer < LAYERS; layer++)
        lanes_to_rows(group.at[layer], count, shape.hidden, group.rows, kept(hidden, shape, rows.count, first, layer));
      for (int i = 0; i < count; i++)
        for (int c = 0; c < COLORS; c++) colors[COLORS * (first + i) + c] = group.at[LAYERS][c * GROUP + i];
    }
  });
}

// Sums of a shard: of the basis, then of each layer.
struct NetworkSums {
  LayerSums basis, layers[LAYERS];

  NetworkSums(float* memory, const Widths& widths) {
    basis = {memory, nullptr, widths.features, widths.components};
    memory += weight_sums(widths.features, widths.components);
    for (int layer = 0; layer < LAYERS; layer++) {
      const int inputs = widths.of[layer], outputs = widths.of[layer + 1];
      float* bias = memory + weight_sums(outputs, inputs);
      layers[layer] = {memory, bias, outputs, inputs};
      memory = bias + outputs * LANES;
    }
  }
  static std::size_t size(const Widths& widths) {
    std::size_t total = weight_sums(widths.features, widths.components);
    for (int layer = 0; layer < LAYERS; layer++)
      total += weight_sums(widths.of[layer + 1], widths.of[layer]) + widths.of[layer + 1] * LANES;
    return total;
  }
};

// The gradient of the network's input `grad` to that of the features, in its first rows: what sines and cosines of
// `input` pass on is added.
void through_waves(const float* input, float* grad, int features) {
  const std::size_t apart = static_cast<std::size_t>(features) * GROUP;
  const float* wave = input + apart + DIRECTION * GROUP;
  const float* by_wave = grad + apart + DIRECTION * GROUP;
  for (std::size_t i = 0; i < apart; i += LANES) {
    Vec sum = load(grad + i);
    for (int frequency = 0; frequency < FREQUENCIES; frequency++) {
      const std::size_t sine = frequency * apart + i, cosine = (FREQUENCIES + frequency) * apart + i;
      const Vec factor(static_cast<float>(1 << frequency));
      sum = fma(factor, fnma(load(by_wave + cosine), load(wave + sine), load(by_wave + sine) * load(wave + cosine)),
                sum);
    }
    store(grad + i, sum);
  }
}

// Adds one group's gradients of the network; on entry grad.at[LAYERS] is that of the colours. Leaves that of the
// features in grad.at[0], and that of the components, where there are any, in grad.components.
template <class Terms>
void go_back(const NetworkPanels<Terms>& panels, const Group& group, const Group& grad, const NetworkSums& sums) {
  const Widths& widths = panels.widths;
  for (int i = 0; i < COLORS * GROUP; i += LANES) {
    const Vec color = load(group.at[LAYERS] + i);
    store(grad.at[LAYERS] + i, load(grad.at[LAYERS] + i) * color * (Vec(1.f) - color));
  }
  for (int layer = LAYERS - 1; layer >= 0; layer--) {
    to_rows<Terms>(group.at[layer], widths.of[layer], group.rows);
    add_layer_gradient<Terms>(sums.layers[layer], grad.at[layer + 1], group.rows, group.terms);
    const float* terms = feature_terms<Terms>(grad.at[layer + 1], widths.of[layer + 1], group.terms);
    dense<Terms>(panels.layers_back[layer], terms, grad.at[layer]);
    if (layer) rectify_gradient(grad.at[layer], group.at[layer], widths.of[layer]);
  }
  through_waves(group.at[0], grad.at[0], widths.features);
  if (!widths.components) return;
  to_rows<Vec>(group.components, widths.components, group.rows);
  add_layer_gradient<Vec>(sums.basis, grad.at[0], group.rows);
  dense<Vec>(panels.basis_back, grad.at[0], grad.components);
}

template <class Terms>
void shade_rows_back(const VolumeShape& shape, const VolumeSeen& seen, const VolumeNetwork<const float>& network,
                     const VolumeRows& rows, const float* directions, const float* hidden, const float* grad_colors,
                     float* grad_seen, const VolumeNetwork<float>& gradients) {
  const Widths widths(shape, seen);
  const int width = widths.components ? widths.components : widths.features;
  const NetworkPanels<Terms> panels(widths, network, true);
  const std::size_t size = NetworkSums::size(widths);
  const Scratch sums(size * SHARDS * sizeof(float));
  const std::size_t share = (rows.count + SHARDS * GROUP - 1) / (SHARDS * GROUP) * GROUP;
  parallel_for(SHARDS, [&](std::size_t shard) {
    const Scratch memory(2 * Group::size(widths) * sizeof(float));
    const MatrixUnit unit;
    const Group group(memory.floats(), widths), grad(memory.floats() + Group::size(widths), widths);
    float* own = sums.floats() + shard * size;
    std::memset(own, 0, size * sizeof(float));
    const NetworkSums of_shard(own, widths);
    const std::size_t end = (shard + 1) * share < rows.count ? (shard + 1) * share : rows.count;
    for (std::size_t first = shard * share; first < end; first += GROUP) {
      const int count = end - first < GROUP ? static_cast<int>(end - first) : GROUP;
      look(panels, seen, rows, first, count, directions, group);
      for (int layer = 1; hidden && layer < LAYERS; layer++)
        rows_to_lanes(kept(hidden, shape, rows.count, first, layer), count, shape.hidden, group.at[layer]);
      evaluate(panels, group, hidden ? LAYERS - 1 : 0);
      for (int c = 0; c < COLORS; c++)
        for (int i = 0; i < GROUP; i++)
          grad.at[LAYERS][c * GROUP + i] = i < count ? grad_colors[COLORS * (first + i) + c] : 0.f;
      go_back(panels, group, grad, of_shard);
      lanes_to_rows(widths.components ? grad.components : grad.at[0], count, width, grad.rows,
                    grad_seen + first * width);
    }
  });
  const Shards all{sums.floats(), size, SHARDS};
  const NetworkSums of_first(sums.floats(), widths);
  if (widths.components) add_up_layer(all, of_first.basis, gradients.basis, nullptr);
  for (int layer = 0; layer < LAYERS; layer++)
    add_up_layer(all, of_first.layers[layer], gradients.weights[layer], gradients.biases[layer]);
}

}  // namespace

void volume_shade(const VolumeShape& shape, const VolumeSeen& seen, const VolumeNetwork<const float>& network,
                  const VolumeRows& rows, const float* directions, bool halves, float* colors, float* hidden) {
  const auto run = halves ? shade_rows<LayerTerms> : shade_rows<Vec>;
  run(shape, seen, network, rows, directions, colors, hidden);
}

void volume_shade_gradient(const VolumeShape& shape, const VolumeSeen& seen,
                           const VolumeNetwork<const float>& network, const VolumeRows& rows, const float* directions,
                           bool halves, const float* hidden, const float* grad_colors, float* grad_seen,
                           const VolumeNetwork<float>& gradients) {
  const auto run = halves ? shade_rows_back<LayerTerms> : shade_rows_back<Vec>;
  run(shape, seen, network, rows, directions, hidden, grad_colors, grad_seen, gradients);
}

}  // namespace ringlight::RINGLIGHT_ISA
