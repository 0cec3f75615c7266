// Dense layers by the matrix unit. Its tiles are what lane_panels.isa.hpp lays out anyway: sixteen outputs by sixteen
// pairs of inputs, times sixteen pairs by sixteen lanes.
#pragma once
#include "dense/lane_panels.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

constexpr int TILE_FLOATS = LANES * LANES, BLOCK_OUTPUTS = 2 * LANES;

// sums[BLOCK_OUTPUTS or LANES][GROUP] = weights x, of `steps` tiles along the inputs.
template <class Tiles, bool Down>
static inline void multiply_block(const float* weights, int steps, const float* x, float* sums) {
  Tiles::clear();
  for (int step = 0; step < steps; step++)
    Tiles::template add_product<Down, true>(weights + step * TILE_FLOATS, LANES, steps * TILE_FLOATS,
                                            x + step * LANES * GROUP, GROUP, LANES);
  Tiles::template store<Down, true>(sums, GROUP);
}

// What becomes of a block's sums, for `outputs` of them; terms are written for a whole block.
template <class Terms, Result Kind>
static inline void finish_block(const float* sums, const float* bias, int outputs, float* y) {
  const auto finished = [=](int o, int v) __attribute__((always_inline)) {
    const Vec sum = load(sums + o * GROUP + v) + Vec(bias ? bias[o] : 0.f);
    return Kind == Result::PLAIN ? sum : max(Vec(0.f), sum);
  };
  if constexpr (Kind == Result::RECTIFIED_TERMS) {
    for (int o = 0; o < outputs; o += 2)
      for (int v = 0; v < GROUP; v += LANES)
        store(y + o / 2 * GROUP + v, Terms::of(finished(o, v), o + 1 < outputs ? finished(o + 1, v) : Vec(0.f)));
    clear_rows(y, (outputs + 1) / 2, LANES);
  } else {
    for (int o = 0; o < outputs; o++)
      for (int v = 0; v < GROUP; v += LANES) store(y + o * GROUP + v, finished(o, v));
  }
}

// dense() of lane_layers.isa.hpp.
template <class Tiles, class Terms, Result Kind>
static inline void dense_tiles(const Panels& layer, const float* x, float* y) {
  const int steps = term_rows<Terms>(layer.inputs) / LANES;
  alignas(64) float sums[BLOCK_OUTPUTS * GROUP];
  before_tile_loads();
  for (int first = 0; first < layer.outputs; first += BLOCK_OUTPUTS) {
    const int left = layer.outputs - first, outputs = left < BLOCK_OUTPUTS ? left : BLOCK_OUTPUTS;
    const float* weights = layer.weights + first / LANES * steps * TILE_FLOATS;
    if (left > LANES)
      multiply_block<Tiles, true>(weights, steps, x, sums);
    else
      multiply_block<Tiles, false>(weights, steps, x, sums);
    const int rows = Kind == Result::RECTIFIED_TERMS ? first / 2 : first;
    finish_block<Terms, Kind>(sums, layer.bias ? layer.bias + first : nullptr, outputs, y + rows * GROUP);
  }
}

template <class Tiles, bool Down, bool Right>
static inline void outer_square(float* sums, int stride, const float* gradient, const float* rows) {
  Tiles::template load<Down, Right>(sums, stride);
  Tiles::template add_product<Down, Right>(gradient, LANES, TILE_FLOATS, rows, LANES, TILE_FLOATS);
  Tiles::template store<Down, Right>(sums, stride);
}

template <class Tiles, bool Down>
static inline void outer_band(float* sums, int stride, const float* gradient, const float* rows) {
  int done = 0;
  for (; done + LANES < stride; done += 2 * LANES)
    outer_square<Tiles, Down, true>(sums + done, stride, gradient, rows + done * LANES);
  if (done < stride) outer_square<Tiles, Down, false>(sums + done, stride, gradient, rows + done * LANES);
}

// sums[padded(outputs)][stride] += gradient rows, over the group: gradient[outputs][16] as lane_terms, rows as to_rows.
template <class Tiles>
static inline void outer_tiles(float* sums, int outputs, int stride, const float* gradient, const float* rows) {
  before_tile_loads();
  int done = 0;
  for (; done + LANES < outputs; done += 2 * LANES)
    outer_band<Tiles, true>(sums + done * stride, stride, gradient + done * LANES, rows);
  if (done < outputs) outer_band<Tiles, false>(sums + done * stride, stride, gradient + done * LANES, rows);
}

}  // namespace ringlight::RINGLIGHT_ISA
