// What dense layers read: weights in the order of use, and a group of Gaussians, one per lane, as the terms of
// multiply-adds.
//
// `Terms` is the type of the factors: Vec, or Bf16Pairs, whose lanes hold two inputs (or two Gaussians) each. Sums
// are floats in any case.
#pragma once
#include "simd/simd.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

constexpr int GROUP = 32;                   // Gaussians handled together: each weight is broadcast once for two Vecs
constexpr bool MANY_REGISTERS = VEC_REGISTERS >= 32;
constexpr int PANEL = MANY_REGISTERS ? 12 : 6;       // outputs whose sums stay in registers ...
constexpr int PANEL_VECS = MANY_REGISTERS ? 2 : 1;   // ... for this many Vecs of the group
constexpr int OUTER_ROWS = 6;                        // the same for weight gradients: rows ...
constexpr int OUTER_VECS = MANY_REGISTERS ? 4 : 1;   // ... times columns / 16

// Whether layers of such terms are multiplied tile by tile, see matrix_layers.isa.hpp.
template <class Terms>
constexpr bool in_unit = HAS_MATRIX_UNIT && numbers_of<Terms> == 2;

// Weights reordered to the order of use: for each panel of outputs, input by input; for the matrix unit tile by tile, a
// tile's outputs one after another, filled up with zeros. `bias` may be null.
struct Panels {
  const float *weights, *bias;
  int outputs, inputs;
};

// Terms that hold so many numbers; the last one is filled up with a zero.
template <class Terms>
constexpr int terms_of(int numbers) {
  return (numbers + numbers_of<Terms> - 1) / numbers_of<Terms>;
}

constexpr int padded(int inputs) { return (inputs + LANES - 1) / LANES * LANES; }

// Rows of a group that they take: whole tiles of them for the matrix unit.
template <class Terms>
constexpr int term_rows(int numbers) {
  return in_unit<Terms> ? padded(terms_of<Terms>(numbers)) : terms_of<Terms>(numbers);
}

// Rows to allow for where a layer of so many outputs leaves what it returns, as numbers or as terms.
constexpr int result_rows(int outputs) { return HAS_MATRIX_UNIT ? padded(outputs) : outputs; }

// Floats of a layer's panels.
template <class Terms>
constexpr std::size_t panel_floats(int outputs, int inputs) {
  return static_cast<std::size_t>(in_unit<Terms> ? padded(outputs) : outputs) * term_rows<Terms>(inputs);
}

// Outputs of the next panel, of so many that are left. One of four has too few sums to hide a multiply-add's latency,
// so that the last two share what they have; all but the last are even, for outputs to make pairs.
constexpr int panel_width(int left) {
  constexpr int FEW = 6;
  return left <= PANEL ? left : MANY_REGISTERS && left < PANEL + FEW ? PANEL - 4 : PANEL;
}

// The weight of output o and input i is at weights[o * output_stride + i * input_stride].
template <class Terms>
static inline void pack_tiles(const float* weights, int output_stride, int input_stride, int outputs, int inputs,
                              float* to) {
  for (int first = 0; first < outputs; first += LANES)
    for (int i = 0; i < 2 * term_rows<Terms>(inputs); i += 2 * LANES)
      for (int o = first; o < first + LANES; o++)
        for (int k = i; k < i + 2 * LANES; k += 2) {
          const float* weight = weights + o * output_stride + k * input_stride;
          const bool one = o < outputs && k < inputs, other = o < outputs && k + 1 < inputs;
          *to++ = Terms::one(one ? *weight : 0.f, other ? weight[input_stride] : 0.f);
        }
}

// The same; takes panel_floats.
template <class Terms = Vec>
static inline Panels pack(const float* weights, int output_stride, int input_stride, const float* bias, int outputs,
                          int inputs, float* to) {
  const Panels packed{to, bias, outputs, inputs};
  if constexpr (in_unit<Terms>) {
    pack_tiles<Terms>(weights, output_stride, input_stride, outputs, inputs, to);
    return packed;
  }
  for (int first = 0, width; first < outputs; first += width) {
    width = panel_width(outputs - first);
    for (int i = 0; i < inputs; i += numbers_of<Terms>)
      for (int k = 0; k < width; k++) {
        const float* weight = weights + (first + k) * output_stride + i * input_stride;
        if constexpr (numbers_of<Terms> == 1)
          *to++ = *weight;
        else
          *to++ = Terms::one(*weight, i + 1 < inputs ? weight[input_stride] : 0.f);
      }
  }
  return packed;
}

static inline void clear_rows(float* rows, int begin, int end) {
  for (int i = begin * GROUP; i < end * GROUP; i += LANES) store(rows + i, Vec(0.f));
}

// x[count][GROUP] as terms, [term_rows(count)][GROUP]: x itself, or written to `buffer`.
template <class Terms>
static inline const float* feature_terms(const float* x, int count, float* buffer) {
  if constexpr (numbers_of<Terms> == 1) {
    return x;
  } else {
    for (int i = 0; i < count; i += 2)
      for (int v = 0; v < GROUP; v += LANES) {
        const Vec odd = i + 1 < count ? load(x + (i + 1) * GROUP + v) : Vec(0.f);
        store(buffer + i / 2 * GROUP + v, Terms::of(load(x + i * GROUP + v), odd));
      }
    clear_rows(buffer, terms_of<Terms>(count), term_rows<Terms>(count));
    return buffer;
  }
}

// The sum over the Gaussians of a group has this many terms.
template <class Terms>
constexpr int GROUP_TERMS = GROUP / numbers_of<Terms>;

// x[count][GROUP] as terms over the Gaussians, [count][GROUP_TERMS]: x itself, or written to `buffer`. Which two
// Gaussians make a pair does not matter, for to_rows makes the same.
template <class Terms>
static inline const float* lane_terms(const float* x, int count, float* buffer) {
  if constexpr (numbers_of<Terms> == 1) {
    return x;
  } else {
    for (int i = 0; i < count; i++)
      store(buffer + i * LANES, Terms::of_neighbours(load(x + i * GROUP), load(x + i * GROUP + LANES)));
    return buffer;
  }
}

// x[inputs][GROUP] to blocks of sixteen inputs, [padded / 16][GROUP_TERMS][16]; the padding is zero.
template <class Terms = Vec>
static inline void to_rows(const float* x, int inputs, float* rows) {
  for (int first = 0; first < inputs; first += LANES)
    for (int half = 0; half < GROUP_TERMS<Terms>; half += LANES, rows += LANES * LANES) {
      Vec square[LANES];
      for (int i = 0; i < LANES; i++) {
        const float* from = x + (first + i) * GROUP + half;
        if constexpr (numbers_of<Terms> == 1)
          square[i] = first + i < inputs ? load(from) : Vec(0.f);
        else
          square[i] = first + i < inputs ? Terms::of_neighbours(load(from), load(from + LANES)).bits() : Vec(0.f);
      }
      transpose(square);
      for (int i = 0; i < LANES; i++) store(rows + i * LANES, square[i]);
    }
}

// What becomes of a layer's sums: stored as they are, or rectified, as numbers or as terms of the next layer.
enum class Result { PLAIN, RECTIFIED, RECTIFIED_TERMS };

// Running sums of a layer's gradient: weight [outputs][padded(inputs)] (for the matrix unit there is room for
// padded(outputs), and what lies beyond the outputs means nothing), bias by lanes [outputs][16] or null.
struct LayerSums {
  float *weight, *bias;
  int outputs, inputs;
};

// Floats of LayerSums::weight.
static inline std::size_t weight_sums(int outputs, int inputs) {
  return static_cast<std::size_t>(result_rows(outputs)) * padded(inputs);
}

}  // namespace ringlight::RINGLIGHT_ISA
