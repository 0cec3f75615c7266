// Dense layers by the matrix unit. Its tiles are what lane_panels.hpp lays out anyway: sixteen outputs by sixteen pairs
// of inputs, times sixteen pairs by sixteen lanes. Include from kernels/isa/*.cpp alone, see simd.hpp.
#pragma once
#include "lane_panels.hpp"

namespace ringlight::RINGLIGHT_ISA {

#ifdef __AMX_BF16__
constexpr int TILE_FLOATS = LANES * LANES, BLOCK_OUTPUTS = 2 * LANES;

// sums[BLOCK_OUTPUTS or LANES][GROUP] = weights x, of `steps` tiles along the inputs; `row` from an output's first tile
// to that of the output sixteen further on.
template <bool Two>
static inline void multiply_block(const float* weights, int row, int steps, const float* x, float* sums) {
  _tile_zero(0);
  _tile_zero(1);
  _tile_zero(2);
  _tile_zero(3);
  for (int step = 0; step < steps; step++, weights += TILE_FLOATS, x += LANES * GROUP)
    multiply_tiles_into_sums<Two>(weights, weights + row, LANES, x, x + LANES, GROUP);
  _tile_stored(0, sums, GROUP * 4);
  _tile_stored(1, sums + LANES, GROUP * 4);
  if constexpr (Two) {
    _tile_stored(2, sums + LANES * GROUP, GROUP * 4);
    _tile_stored(3, sums + LANES * GROUP + LANES, GROUP * 4);
  }
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

// dense() of lane_layers.hpp.
template <class Terms, Result Kind>
static inline void dense_tiles(const Panels& layer, const float* x, float* y) {
  const int steps = term_rows<Terms>(layer.inputs) / LANES, row = steps * TILE_FLOATS;
  alignas(64) float sums[BLOCK_OUTPUTS * GROUP];
  before_tile_loads();
  for (int first = 0; first < layer.outputs; first += BLOCK_OUTPUTS) {
    const int left = layer.outputs - first, outputs = left < BLOCK_OUTPUTS ? left : BLOCK_OUTPUTS;
    const float *weights = layer.weights + first / LANES * row, *bias = layer.bias ? layer.bias + first : nullptr;
    if (left > LANES)
      multiply_block<true>(weights, row, steps, x, sums);
    else
      multiply_block<false>(weights, row, steps, x, sums);
    const int rows = Kind == Result::RECTIFIED_TERMS ? first / 2 : first;
    finish_block<Terms, Kind>(sums, bias, outputs, y + rows * GROUP);
  }
}

// Tiles 0 to 3 hold sums of outputs by inputs here, at the corners of a square; those beyond `Down` and `Right` are
// left alone.
template <bool Down, bool Right>
static inline void outer_square(float* sums, int stride, const float* gradient, const float* rows) {
  float* const below = sums + LANES * stride;
  _tile_loadd(0, sums, stride * 4);
  if constexpr (Right) _tile_loadd(1, sums + LANES, stride * 4);
  if constexpr (Down) _tile_loadd(2, below, stride * 4);
  if constexpr (Down && Right) _tile_loadd(3, below + LANES, stride * 4);
  multiply_tiles_into_sums<Down>(gradient, gradient + TILE_FLOATS, LANES, rows, Right ? rows + TILE_FLOATS : rows,
                                 LANES);
  _tile_stored(0, sums, stride * 4);
  if constexpr (Right) _tile_stored(1, sums + LANES, stride * 4);
  if constexpr (Down) _tile_stored(2, below, stride * 4);
  if constexpr (Down && Right) _tile_stored(3, below + LANES, stride * 4);
}

template <bool Down>
static inline void outer_band(float* sums, int stride, const float* gradient, const float* rows) {
  int done = 0;
  for (; done + LANES < stride; done += 2 * LANES)
    outer_square<Down, true>(sums + done, stride, gradient, rows + done * LANES);
  if (done < stride) outer_square<Down, false>(sums + done, stride, gradient, rows + done * LANES);
}

// sums[padded(outputs)][stride] += gradient rows, over the group: gradient[outputs][16] as lane_terms, rows as to_rows.
static inline void outer_tiles(float* sums, int outputs, int stride, const float* gradient, const float* rows) {
  before_tile_loads();
  int done = 0;
  for (; done + LANES < outputs; done += 2 * LANES)
    outer_band<true>(sums + done * stride, stride, gradient + done * LANES, rows);
  if (done < outputs) outer_band<false>(sums + done * stride, stride, gradient + done * LANES, rows);
}
#else
template <class Terms, Result Kind>
static inline void dense_tiles(const Panels&, const float*, float*) {}
static inline void outer_tiles(float*, int, int, const float*, const float*) {}
#endif

}  // namespace ringlight::RINGLIGHT_ISA
