// Dense layers for a group of Gaussians, one per lane: x[feature] is a vector over the group, weights are broadcast.
// A layer of O outputs and I inputs is O x I fused multiply-adds on full vectors with sums in registers, which runs
// near the peak of the processor; by the matrix unit, where there is one, in a tenth of the time.
#pragma once
#include "dense/lane_panels.isa.hpp"
#include "dense/matrix_layers.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

template <class Terms, int Outputs, Result Kind>
RINGLIGHT_INLINE void store_sums(const Vec sums[Outputs][PANEL_VECS], float* y) {
  const auto finished = [](Vec sum) __attribute__((always_inline)) {
    return Kind == Result::PLAIN ? sum : max(Vec(0.f), sum);
  };
#pragma GCC unroll 16
  for (int k = 0; k < Outputs; k++)
#pragma GCC unroll 2
    for (int v = 0; v < PANEL_VECS; v++)
      if constexpr (Kind == Result::RECTIFIED_TERMS && numbers_of<Terms> == 2) {
        if (k % 2) continue;
        const Vec odd = k + 1 < Outputs ? finished(sums[k + 1 < Outputs ? k + 1 : k][v]) : Vec(0.f);
        store(y + k / 2 * GROUP + v * LANES, Terms::of(finished(sums[k][v]), odd));
      } else {
        store(y + k * GROUP + v * LANES, finished(sums[k][v]));
      }
}

template <class Terms, int Outputs, Result Kind>
static void panel(const float* weights, const float* bias, int terms, const float* x, float* y) {
  // A sum of few outputs is taken in parts, which do not wait for each other.
  constexpr int PARTS = Outputs * PANEL_VECS <= 2 ? 4 : Outputs * PANEL_VECS <= 6 ? 2 : 1;
  for (int first = 0; first < GROUP; first += PANEL_VECS * LANES) {
    Vec sums[PARTS][Outputs][PANEL_VECS];
#pragma GCC unroll 4
    for (int p = 0; p < PARTS; p++)
#pragma GCC unroll 16
      for (int k = 0; k < Outputs; k++)
#pragma GCC unroll 2
        for (int v = 0; v < PANEL_VECS; v++) sums[p][k][v] = Vec(bias && p == 0 ? bias[k] : 0.f);
    const float* weight = weights;
    const float* value = x + first;
    const auto add_term = [&](int p) __attribute__((always_inline)) {
      Terms values[PANEL_VECS];
#pragma GCC unroll 2
      for (int v = 0; v < PANEL_VECS; v++) values[v] = load(value + v * LANES);
#pragma GCC unroll 16
      for (int k = 0; k < Outputs; k++) {
        const Terms factor(weight[k]);
#pragma GCC unroll 2
        for (int v = 0; v < PANEL_VECS; v++) sums[p][k][v] = fma(factor, values[v], sums[p][k][v]);
      }
      weight += Outputs, value += GROUP;
    };
    int i = 0;
    for (; i + PARTS <= terms; i += PARTS)
#pragma GCC unroll 4
      for (int p = 0; p < PARTS; p++) add_term(p);
    for (; PARTS > 1 && i < terms; i++) add_term(0);
#pragma GCC unroll 4
    for (int p = 1; p < PARTS; p++)
#pragma GCC unroll 16
      for (int k = 0; k < Outputs; k++)
#pragma GCC unroll 2
        for (int v = 0; v < PANEL_VECS; v++) sums[0][k][v] += sums[p][k][v];
    store_sums<Terms, Outputs, Kind>(sums[0], y + first);
  }
}

template <class Terms, int Outputs, Result Kind>
static void narrow_panel(int outputs, const float* weights, const float* bias, int terms, const float* x, float* y) {
  if (outputs == Outputs)
    panel<Terms, Outputs, Kind>(weights, bias, terms, x, y);
  else if constexpr (Outputs > 1)
    narrow_panel<Terms, Outputs - 1, Kind>(outputs, weights, bias, terms, x, y);
}

// y[outputs][GROUP] = weights x[inputs][GROUP] + bias, x as feature_terms. RECTIFIED_TERMS are complete, as those of
// feature_terms.
template <class Terms = Vec, Result Kind = Result::PLAIN>
static inline void dense(const Panels& layer, const float* x, float* y) {
  if constexpr (in_unit<Terms>) return dense_tiles<TileSums, Terms, Kind>(layer, x, y);
  const float *weights = layer.weights, *bias = layer.bias;
  const int terms = terms_of<Terms>(layer.inputs);
  const int numbers = Kind == Result::RECTIFIED_TERMS ? numbers_of<Terms> : 1;
  for (int left = layer.outputs, width; left > 0; left -= width) {
    width = panel_width(left);
    narrow_panel<Terms, PANEL, Kind>(width, weights, bias, terms, x, y);
    weights += width * terms, y += width / numbers * GROUP;
    if (bias) bias += width;
  }
}

// The gradient of a layer's Result::RECTIFIED, from what it returned.
static inline void rectify_gradient(float* gradient, const float* rectified, int count) {
  for (int i = 0; i < count * GROUP; i += LANES)
    store(gradient + i, keep(gt(load(rectified + i), Vec(0.f)), load(gradient + i)));
}

template <class Terms, int Rows, int Vecs>
static void outer_block(float* sums, int stride, const float* gradient, const float* rows) {
  Vec block[Rows][Vecs];
#pragma GCC unroll 8
  for (int r = 0; r < Rows; r++)
#pragma GCC unroll 4
    for (int v = 0; v < Vecs; v++) block[r][v] = load(sums + r * stride + v * LANES);
  for (int term = 0; term < GROUP_TERMS<Terms>; term++) {
    Terms values[Vecs];
#pragma GCC unroll 4
    for (int v = 0; v < Vecs; v++) values[v] = load(rows + (v * GROUP_TERMS<Terms> + term) * LANES);
#pragma GCC unroll 8
    for (int r = 0; r < Rows; r++) {
      const Terms factor(gradient[r * GROUP_TERMS<Terms> + term]);
#pragma GCC unroll 4
      for (int v = 0; v < Vecs; v++) block[r][v] = fma(factor, values[v], block[r][v]);
    }
  }
#pragma GCC unroll 8
  for (int r = 0; r < Rows; r++)
#pragma GCC unroll 4
    for (int v = 0; v < Vecs; v++) store(sums + r * stride + v * LANES, block[r][v]);
}

template <class Terms, int Rows>
static void outer_rows(float* sums, int stride, const float* gradient, const float* rows) {
  int done = 0;
  for (; done + OUTER_VECS * LANES <= stride; done += OUTER_VECS * LANES)
    outer_block<Terms, Rows, OUTER_VECS>(sums + done, stride, gradient, rows + done * GROUP_TERMS<Terms>);
  // Narrow layers: two columns of Vecs still keep the multipliers busy, one would wait for its own sums.
  if constexpr (OUTER_VECS > 2)
    for (; done + 2 * LANES <= stride; done += 2 * LANES)
      outer_block<Terms, Rows, 2>(sums + done, stride, gradient, rows + done * GROUP_TERMS<Terms>);
  if constexpr (OUTER_VECS > 1)
    for (; done < stride; done += LANES)
      outer_block<Terms, Rows, 1>(sums + done, stride, gradient, rows + done * GROUP_TERMS<Terms>);
}

template <class Terms, int Rows>
static void outer_last_rows(int count, float* sums, int stride, const float* gradient, const float* rows) {
  if (count == Rows)
    outer_rows<Terms, Rows>(sums, stride, gradient, rows);
  else if constexpr (Rows > 1)
    outer_last_rows<Terms, Rows - 1>(count, sums, stride, gradient, rows);
}

// Adds the group's part of dL/dweight and dL/dbias: gradient[outputs][GROUP] of the layer's result, and its input as
// `to_rows` left it. `buffer` has result_rows(outputs) rows of sixteen, unless Terms are floats.
template <class Terms = Vec>
static inline void add_layer_gradient(const LayerSums& sums, const float* gradient, const float* rows,
                                      float* buffer = nullptr) {
  const int stride = padded(sums.inputs);
  const float* terms = lane_terms<Terms>(gradient, sums.outputs, buffer);
  if constexpr (in_unit<Terms>) {
    outer_tiles<TileSums>(sums.weight, sums.outputs, stride, terms, rows);
  } else {
    int done = 0;
    for (; done + OUTER_ROWS <= sums.outputs; done += OUTER_ROWS)
      outer_rows<Terms, OUTER_ROWS>(sums.weight + done * stride, stride, terms + done * GROUP_TERMS<Terms>, rows);
    outer_last_rows<Terms, OUTER_ROWS - 1>(sums.outputs - done, sums.weight + done * stride, stride,
                                           terms + done * GROUP_TERMS<Terms>, rows);
  }
  if (!sums.bias) return;
  for (int o = 0; o < sums.outputs; o++) {
    float* bias = sums.bias + o * LANES;
    store(bias, load(bias) + load(gradient + o * GROUP) + load(gradient + o * GROUP + LANES));
  }
}

}  // namespace ringlight::RINGLIGHT_ISA
