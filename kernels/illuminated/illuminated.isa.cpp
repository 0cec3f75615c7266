#include "illuminated/illuminated.hpp"

#include "illuminated/light_network.isa.hpp"
#include "simd/row_columns.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

constexpr std::size_t GROUPS_PER_PIECE = 8;

}  // namespace

void light_forward(const LightField& field, const LitGaussians& lit, float* specular) {
  const LightPanels panels(field, false);
  const HeadPanels network = panels.network.of(0, false);
  parallel_ranges(lit.count, GROUPS_PER_PIECE * GROUP, [&](std::size_t begin, std::size_t end) {
    const std::size_t block = panels.block();
    const Scratch memory(4 * block * sizeof(float));
    const MatrixUnit unit;
    float *const products = memory.floats(), *const inputs = products + block;
    float *const terms = inputs + block, *const hidden = terms + block;
    for (std::size_t first = begin; first < end; first += GROUP) {
      const LitLanes lanes(lit, first);
      fill_group(field, lit, lanes, products, inputs, nullptr);
      mix_group(field, panels, products, inputs, terms);
      const float* given = feature_terms<LayerTerms>(inputs, field.network.inputs, terms);
      dense<LayerTerms, Result::RECTIFIED_TERMS>(network.layers[0], given, hidden);
      dense<LayerTerms, Result::RECTIFIED_TERMS>(network.layers[1], hidden, products);
      dense<LayerTerms>(network.layers[2], products, hidden);
      for (int half = 0; half < lanes.count; half += LANES) {
        Vec color[LANES];
        for (int c = 0; c < LIT_WIDTH; c++) color[c] = tanh_fast(load(hidden + c * GROUP + half));
        for (int c = LIT_WIDTH; c < LANES; c++) color[c] = Vec(0.f);
        const int some = lanes.count - half < LANES ? lanes.count - half : LANES;
        put_columns(specular + LIT_WIDTH * (first + half), LIT_WIDTH, some, color);
      }
    }
  });
}

}  // namespace ringlight::RINGLIGHT_ISA
