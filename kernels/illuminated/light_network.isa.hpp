// The field's matrix and the network behind it, packed; and the forward pass of a group.
#pragma once
#include "dense/perceptron_layers.isa.hpp"
#include "illuminated/lit_group.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

struct LightPanels {
  StackPanels network;
  Scratch memory;
  Widths widths;  // the widest layer is that of the network and the matrix
  Panels mix, transposed_mix;

  LightPanels(const LightField& field, bool with_transposed)
      : network(field.network, field.layers, with_transposed),
        memory((panel_floats<LayerTerms>(field.features, field.joined()) +
                panel_floats<LayerTerms>(field.joined(), field.features)) *
               sizeof(float)),
        widths(network.widths) {
    const int joined = field.joined(), features = field.features, rows = result_rows(joined);
    if (rows > widths.widest) widths.widest = rows;
    float* const to = memory.floats();
    mix = pack<LayerTerms>(field.mix, joined, 1, field.offset, features, joined, to);
    if (with_transposed)
      transposed_mix = pack<LayerTerms>(field.mix, 1, joined, nullptr, joined, features,
                                        to + panel_floats<LayerTerms>(features, joined));
  }
  // Floats of one [width][GROUP], whatever the layer.
  std::size_t block() const { return static_cast<std::size_t>(widths.widest + LANES) * GROUP; }
};

// inputs[..][GROUP] whole, from what fill_group left.
static inline void mix_group(const LightField& field, const LightPanels& panels, const float* products, float* inputs,
                             float* terms) {
  dense<LayerTerms>(panels.mix, feature_terms<LayerTerms>(products, field.joined(), terms),
                    inputs + field.features * GROUP);
  for (int i = 0; i < 2 * field.features * GROUP; i += LANES) store(inputs + i, tanh_fast(load(inputs + i)));
}

}  // namespace
}  // namespace ringlight::RINGLIGHT_ISA
