#include "ring.hpp"

#include "parallel.hpp"
#include "ring_batch.hpp"
#include "ring_product.hpp"
#include "scratch.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

constexpr std::size_t ROWS_PER_PIECE = 512;  // a fraction of a millisecond; scratch memory is made once a piece
constexpr std::size_t BASE_GRAIN = 16384;    // floats a piece of the base colours

void write(const Batch& batch, const RingShape& shape, const RingOutputs& outputs) {
  for (int i = 0; i < 3 * GROUP; i += LANES) {
    // max first: a NaN is handed on
    const Vec sum = load(batch.base + i) + load(batch.residual + i);
    store(batch.base + i, min(Vec(1.f), max(Vec(0.f), sum)));
  }
  if (batch.consecutive && !outputs.residual && !outputs.modulation) {
    for (int first = 0; first < GROUP; first += LANES)
      store_columns(outputs.color + 3 * (static_cast<std::size_t>(batch.rows[0]) + first), load(batch.base + first),
                    load(batch.base + GROUP + first), load(batch.base + 2 * GROUP + first));
    return;
  }
  for (int lane = 0; lane < batch.count; lane++) {
    const std::size_t row = batch.rows[lane];
    for (int c = 0; c < 3; c++) outputs.color[3 * row + c] = batch.base[c * GROUP + lane];
    if (outputs.residual)
      for (int c = 0; c < 3; c++) outputs.residual[3 * row + c] = batch.residual[c * GROUP + lane];
    if (outputs.modulation) outputs.modulation[row] = modulated(shape) ? batch.modulation[lane] : 1.f;
  }
}

void write_base_colors(const RingScene& scene, float* color) {
  parallel_ranges(3 * scene.count, BASE_GRAIN, [=](std::size_t begin, std::size_t end) {
    std::size_t i = begin;
    for (; i + LANES <= end; i += LANES) store(color + i, sigmoid(load(scene.base + i)));
    const int left = static_cast<int>(end - i);
    if (left) store_first(color + i, sigmoid(load_first(scene.base + i, left)), left);
  });
}

}  // namespace

void ring_forward(const RingShape& shape, const RingParameters<const float>& parameters, const RingScene& scene,
                  const RingOutputs& outputs) {
  write_base_colors(scene, outputs.color);
  Arena counter{nullptr};
  pack_layers(shape, parameters, counter);
  const Scratch packed(counter.used * sizeof(float));
  Arena weights{packed.floats()};
  const RingPanels panels = pack_layers(shape, parameters, weights);
  parallel_ranges(scene.visible_count, ROWS_PER_PIECE, [&](std::size_t begin, std::size_t end) {
    Batch batch;
    Arena needed{nullptr};
    lay_out(batch, shape, false, needed);
    const Scratch memory(needed.used * sizeof(float));
    Arena scratch{memory.floats()};
    lay_out(batch, shape, false, scratch);
    for (std::size_t first = begin; first < end; first += GROUP) {
      const int count = end - first < GROUP ? static_cast<int>(end - first) : GROUP;
      start(batch, shape, scene, scene.visible + first, count);
      multiply<false>(batch, shape, parameters, panels.tables);
      shade<false>(batch, shape, panels);
      write(batch, shape, outputs);
    }
  });
}

}  // namespace ringlight::RINGLIGHT_ISA
