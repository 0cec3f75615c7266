// Dense layers for a group of Gaussians, one per lane: x[feature] is a vector over the group, weights are broadcast.
// A layer of O outputs and I inputs is O x I fused multiply-adds on full vectors with sums in registers, which runs
// near the peak of the processor. Include from kernels/isa/*.cpp alone, see simd.hpp.
#pragma once
#include "simd.hpp"

namespace ringlight::RINGLIGHT_ISA {

constexpr int GROUP = 32;                   // Gaussians handled together: each weight is broadcast once for two Vecs
constexpr bool MANY_REGISTERS = VEC_REGISTERS >= 32;
constexpr int PANEL = MANY_REGISTERS ? 12 : 6;       // outputs whose sums stay in registers ...
constexpr int PANEL_VECS = MANY_REGISTERS ? 2 : 1;   // ... for this many Vecs of the group
constexpr int OUTER_ROWS = 6;                        // the same for weight gradients: rows ...
constexpr int OUTER_VECS = MANY_REGISTERS ? 4 : 1;   // ... times columns / 16

// Weights reordered to the order of use: for each panel of outputs, input by input. `bias` may be null.
struct Panels {
  const float *weights, *bias;
  int outputs, inputs;
};

// The weight of output o and input i is at weights[o * output_stride + i * input_stride].
static inline Panels pack(const float* weights, int output_stride, int input_stride, const float* bias, int outputs,
                          int inputs, float* to) {
  const Panels packed{to, bias, outputs, inputs};
  for (int first = 0; first < outputs; first += PANEL) {
    const int width = outputs - first < PANEL ? outputs - first : PANEL;
    for (int i = 0; i < inputs; i++)
      for (int k = 0; k < width; k++) *to++ = weights[(first + k) * output_stride + i * input_stride];
  }
  return packed;
}

template <int Outputs>
static void panel(const float* weights, const float* bias, int inputs, const float* x, float* y) {
  for (int first = 0; first < GROUP; first += PANEL_VECS * LANES) {
    Vec sums[Outputs][PANEL_VECS];
#pragma GCC unroll 16
    for (int k = 0; k < Outputs; k++)
#pragma GCC unroll 2
      for (int v = 0; v < PANEL_VECS; v++) sums[k][v] = Vec(bias ? bias[k] : 0.f);
    const float* weight = weights;
    const float* value = x + first;
    for (int i = 0; i < inputs; i++, weight += Outputs, value += GROUP) {
      Vec values[PANEL_VECS];
#pragma GCC unroll 2
      for (int v = 0; v < PANEL_VECS; v++) values[v] = load(value + v * LANES);
#pragma GCC unroll 16
      for (int k = 0; k < Outputs; k++) {
        const Vec factor(weight[k]);
#pragma GCC unroll 2
        for (int v = 0; v < PANEL_VECS; v++) sums[k][v] = fma(factor, values[v], sums[k][v]);
      }
    }
#pragma GCC unroll 16
    for (int k = 0; k < Outputs; k++)
#pragma GCC unroll 2
      for (int v = 0; v < PANEL_VECS; v++) store(y + k * GROUP + first + v * LANES, sums[k][v]);
  }
}

// The last panel, narrower than the others.
template <int Outputs>
static void narrow_panel(int outputs, const float* weights, const float* bias, int inputs, const float* x, float* y) {
  if (outputs == Outputs)
    panel<Outputs>(weights, bias, inputs, x, y);
  else if constexpr (Outputs > 1)
    narrow_panel<Outputs - 1>(outputs, weights, bias, inputs, x, y);
}

// y[outputs][GROUP] = weights x[inputs][GROUP] + bias.
static inline void dense(const Panels& layer, const float* x, float* y) {
  const float *weights = layer.weights, *bias = layer.bias;
  int left = layer.outputs;
  for (; left >= PANEL; left -= PANEL, weights += PANEL * layer.inputs, y += PANEL * GROUP) {
    panel<PANEL>(weights, bias, layer.inputs, x, y);
    if (bias) bias += PANEL;
  }
  narrow_panel<PANEL - 1>(left, weights, bias, layer.inputs, x, y);
}

static inline void rectify(float* values, int count) {
  for (int i = 0; i < count * GROUP; i += LANES) store(values + i, max(Vec(0.f), load(values + i)));
}

// The gradient of rectify, from what it returned.
static inline void rectify_gradient(float* gradient, const float* rectified, int count) {
  for (int i = 0; i < count * GROUP; i += LANES)
    store(gradient + i, keep(gt(load(rectified + i), Vec(0.f)), load(gradient + i)));
}

constexpr int padded(int inputs) { return (inputs + LANES - 1) / LANES * LANES; }

// x[inputs][GROUP] to blocks of sixteen inputs, [padded / 16][GROUP][16]; the padding is zero.
static inline void to_rows(const float* x, int inputs, float* rows) {
  for (int first = 0; first < inputs; first += LANES)
    for (int half = 0; half < GROUP; half += LANES, rows += LANES * LANES) {
      Vec square[LANES];
      for (int i = 0; i < LANES; i++)
        square[i] = first + i < inputs ? load(x + (first + i) * GROUP + half) : Vec(0.f);
      transpose(square);
      for (int i = 0; i < LANES; i++) store(rows + i * LANES, square[i]);
    }
}

// Running sums of a layer's gradient: weight [outputs][padded(inputs)], bias by lanes [outputs][16] or null.
struct LayerSums {
  float *weight, *bias;
  int outputs, inputs;
};

template <int Rows, int Vecs>
static void outer_block(float* sums, int stride, const float* gradient, const float* rows) {
  Vec block[Rows][Vecs];
#pragma GCC unroll 8
  for (int r = 0; r < Rows; r++)
#pragma GCC unroll 4
    for (int v = 0; v < Vecs; v++) block[r][v] = load(sums + r * stride + v * LANES);
  for (int lane = 0; lane < GROUP; lane++) {
    Vec values[Vecs];
#pragma GCC unroll 4
    for (int v = 0; v < Vecs; v++) values[v] = load(rows + (v * GROUP + lane) * LANES);
#pragma GCC unroll 8
    for (int r = 0; r < Rows; r++) {
      const Vec factor(gradient[r * GROUP + lane]);
#pragma GCC unroll 4
      for (int v = 0; v < Vecs; v++) block[r][v] = fma(factor, values[v], block[r][v]);
    }
  }
#pragma GCC unroll 8
  for (int r = 0; r < Rows; r++)
#pragma GCC unroll 4
    for (int v = 0; v < Vecs; v++) store(sums + r * stride + v * LANES, block[r][v]);
}

template <int Rows>
static void outer_rows(float* sums, int stride, const float* gradient, const float* rows) {
  int done = 0;
  for (; done + OUTER_VECS * LANES <= stride; done += OUTER_VECS * LANES)
    outer_block<Rows, OUTER_VECS>(sums + done, stride, gradient, rows + done * GROUP);
  if constexpr (OUTER_VECS > 1)
    for (; done < stride; done += LANES) outer_block<Rows, 1>(sums + done, stride, gradient, rows + done * GROUP);
}

template <int Rows>
static void outer_last_rows(int count, float* sums, int stride, const float* gradient, const float* rows) {
  if (count == Rows)
    outer_rows<Rows>(sums, stride, gradient, rows);
  else if constexpr (Rows > 1)
    outer_last_rows<Rows - 1>(count, sums, stride, gradient, rows);
}

// Adds the group's part of dL/dweight and dL/dbias: gradient[outputs][GROUP] of the layer's result, and its input as
// `to_rows` left it.
static inline void add_layer_gradient(const LayerSums& sums, const float* gradient, const float* rows) {
  const int stride = padded(sums.inputs);
  int done = 0;
  for (; done + OUTER_ROWS <= sums.outputs; done += OUTER_ROWS)
    outer_rows<OUTER_ROWS>(sums.weight + done * stride, stride, gradient + done * GROUP, rows);
  outer_last_rows<OUTER_ROWS - 1>(sums.outputs - done, sums.weight + done * stride, stride, gradient + done * GROUP,
                                  rows);
  if (!sums.bias) return;
  for (int o = 0; o < sums.outputs; o++) {
    float* bias = sums.bias + o * LANES;
    store(bias, load(bias) + load(gradient + o * GROUP) + load(gradient + o * GROUP + LANES));
  }
}

}  // namespace ringlight::RINGLIGHT_ISA
