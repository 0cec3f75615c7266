// A dense layer behind a rectifier with both factors as bytes, for pictures: a fourth of the multiply-adds of floats.
// A lane's inputs share one scale, their largest being 255, and an output's weights another, their largest being 127;
// sums are whole numbers and exact. As lane_layers.isa.hpp otherwise.
#pragma once
#include "dense/lane_layers.isa.hpp"
#include "machine/scratch.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

constexpr int BYTES_IN_WORD = 4;
constexpr float LARGEST_INPUT = 255, LARGEST_WEIGHT = 127;
constexpr float SMALLEST_SCALE = 1e-30f;  // of inputs that are all zero: no division by zero

constexpr int words_of(int numbers) { return (numbers + BYTES_IN_WORD - 1) / BYTES_IN_WORD; }

// Weights in the order of use, as Panels; those of output k were divided by scales[k].
struct BytePanels {
  const std::int32_t* weights;
  const float *scales, *bias;
  int outputs, inputs;
};

// `weights` [outputs inputs]; with a null arena only counts.
static inline BytePanels pack_bytes(const float* weights, const float* bias, int outputs, int inputs, Arena& arena) {
  const int words = words_of(inputs);
  auto* to = reinterpret_cast<std::int8_t*>(arena.take(static_cast<std::size_t>(words) * outputs));
  float* const scales = arena.take(outputs);
  const BytePanels packed{reinterpret_cast<std::int32_t*>(to), scales, bias, outputs, inputs};
  if (!to) return packed;
  for (int o = 0; o < outputs; o++) {
    float largest = SMALLEST_SCALE, zero = 0;  // or NaN, which a scale hands on where bytes cannot
    for (int i = 0; i < inputs; i++) {
      const float weight = weights[o * inputs + i], size = __builtin_fabsf(weight);
      largest = size > largest ? size : largest;
      zero += weight * 0.f;
    }
    scales[o] = largest / LARGEST_WEIGHT + zero;
  }
  const auto byte = [=](int o, int i) {
    const float scaled = weights[o * inputs + i] / scales[o];
    return scaled == scaled ? static_cast<std::int8_t>(__builtin_lrintf(scaled)) : std::int8_t{0};
  };
  for (int first = 0, width; first < outputs; first += width) {
    width = panel_width(outputs - first);
    for (int word = 0; word < words; word++)
      for (int o = first; o < first + width; o++)
        for (int i = BYTES_IN_WORD * word; i < BYTES_IN_WORD * (word + 1); i++)
          *to++ = i < inputs ? byte(o, i) : std::int8_t{0};
  }
  return packed;
}

// x[count][GROUP], not negative, to words[words_of(count)][GROUP] and what a lane's were divided by, scales[GROUP].
template <class Bytes>
static inline void to_bytes(const float* x, int count, std::int32_t* words, float* scales) {
  for (int v = 0; v < GROUP; v += LANES) {
    Vec largest(SMALLEST_SCALE), zero(0.f);  // or NaN, see pack_bytes
    for (int i = 0; i < count; i++) {
      const Vec input = load(x + i * GROUP + v);
      largest = max(largest, input);
      zero = fma(input, Vec(0.f), zero);
    }
    store(scales + v, fma(largest, Vec(1 / LARGEST_INPUT), zero));
    const Vec inverse = Vec(LARGEST_INPUT) / largest;
    for (int word = 0; word < words_of(count); word++) {
      Vec scaled[BYTES_IN_WORD];
      for (int k = 0; k < BYTES_IN_WORD; k++) {
        const int i = BYTES_IN_WORD * word + k;
        scaled[k] = i < count ? load(x + i * GROUP + v) * inverse : Vec(0.f);
      }
      store(words + word * GROUP + v, Bytes::of(scaled[0], scaled[1], scaled[2], scaled[3]));
    }
  }
}

template <class Bytes, int Outputs>
static void byte_panel(const std::int32_t* weights, const float* of_outputs, const float* bias, int words,
                       const std::int32_t* x, const float* of_lanes, float* y) {
  for (int first = 0; first < GROUP; first += PANEL_VECS * LANES) {
    typename Bytes::Sums sums[Outputs][PANEL_VECS];
#pragma GCC unroll 16
    for (int k = 0; k < Outputs; k++)
#pragma GCC unroll 2
      for (int v = 0; v < PANEL_VECS; v++) sums[k][v] = Bytes::Sums::zero();
    for (int word = 0; word < words; word++) {
      IVec values[PANEL_VECS];
#pragma GCC unroll 2
      for (int v = 0; v < PANEL_VECS; v++) values[v] = load_ints(x + word * GROUP + first + v * LANES);
#pragma GCC unroll 16
      for (int k = 0; k < Outputs; k++) {
        const IVec weight = ivec(weights[word * Outputs + k]);
#pragma GCC unroll 2
        for (int v = 0; v < PANEL_VECS; v++) sums[k][v] = fma(Bytes(values[v]), Bytes(weight), sums[k][v]);
      }
    }
    Vec results[Outputs][PANEL_VECS];
#pragma GCC unroll 16
    for (int k = 0; k < Outputs; k++)
#pragma GCC unroll 2
      for (int v = 0; v < PANEL_VECS; v++)
        results[k][v] =
            fma(to_float(sums[k][v]) * Vec(of_outputs[k]), load(of_lanes + first + v * LANES), Vec(bias[k]));
    store_sums<LayerTerms, Outputs, Result::RECTIFIED_TERMS>(results, y + first);
  }
}

template <class Bytes, int Outputs>
static void narrow_byte_panel(int outputs, const std::int32_t* weights, const float* of_outputs, const float* bias,
                              int words, const std::int32_t* x, const float* of_lanes, float* y) {
  if (outputs == Outputs)
    byte_panel<Bytes, Outputs>(weights, of_outputs, bias, words, x, of_lanes, y);
  else if constexpr (Outputs > 1)
    narrow_byte_panel<Bytes, Outputs - 1>(outputs, weights, of_outputs, bias, words, x, of_lanes, y);
}

// y = rectified weights x + bias as terms of the next layer, x as to_bytes left it.
template <class Bytes>
static inline void dense_bytes(const BytePanels& layer, const std::int32_t* x, const float* of_lanes, float* y) {
  const int words = words_of(layer.inputs);
  for (int first = 0, width; first < layer.outputs; first += width) {
    width = panel_width(layer.outputs - first);
    narrow_byte_panel<Bytes, PANEL>(width, layer.weights + first * words, layer.scales + first, layer.bias + first,
                                    words, x, of_lanes, y + first / numbers_of<LayerTerms> * GROUP);
  }
}

}  // namespace ringlight::RINGLIGHT_ISA
