// Dense layers by the matrix unit with a Gaussian to a row. What a layer returns is then in the order of the next
// one, whereas with a Gaussian to a lane (matrix_layers.isa.hpp) pairs of outputs have to be interleaved. Forward only:
// the gradients of weights are sums over Gaussians, which want lanes.
#pragma once
#include "dense/matrix_layers.isa.hpp"
#include "machine/scratch.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

constexpr int STEP_INPUTS = 2 * LANES;  // of one multiply-add of tiles

// Weights tile after tile, of sixteen pairs of inputs by sixteen outputs; all that is missing is zero, of the bias too.
struct RowPanels {
  const float *weights, *bias;
  int outputs, inputs;
};

constexpr int row_steps(int inputs) { return (inputs + STEP_INPUTS - 1) / STEP_INPUTS; }

// Sums of a Gaussian: whole steps of the next layer, but for layers of few outputs, which are the last.
constexpr int row_width(int outputs) { return outputs <= LANES ? LANES : row_steps(outputs) * STEP_INPUTS; }

// Floats of a group's terms of so many inputs, [row_steps][GROUP][LANES].
constexpr std::size_t row_terms(int inputs) { return static_cast<std::size_t>(row_steps(inputs)) * GROUP * LANES; }

// The weight of output o and input k is at weights[o * stride + place(k)]. `bias` may be null.
template <class Terms, class Place>
static inline RowPanels pack_rows(const float* weights, int stride, const float* bias, int outputs, int inputs,
                                  Arena& arena, Place place) {
  const int width = row_width(outputs), padded_inputs = row_steps(inputs) * STEP_INPUTS;
  float *to = arena.take(static_cast<std::size_t>(width) * padded_inputs / 2), *shifts = arena.take(width);
  const RowPanels packed{to, shifts, outputs, inputs};
  if (!to) return packed;
  const auto weight = [=](int o, int k) { return o < outputs && k < inputs ? weights[o * stride + place(k)] : 0.f; };
  for (int first = 0; first < width; first += LANES)
    for (int k = 0; k < padded_inputs; k += 2)
      for (int o = first; o < first + LANES; o++) *to++ = Terms::one(weight(o, k), weight(o, k + 1));
  for (int o = 0; o < width; o++) shifts[o] = bias && o < outputs ? bias[o] : 0.f;
  return packed;
}

// sums[GROUP][width] of sixteen outputs, or with Right of 32.
template <class Tiles, bool Right>
static inline void multiply_rows(const float* weights, const float* bias, int steps, const float* x, float* sums,
                                 int width) {
  Tiles::template load<true, Right>(bias, 0);  // the same for all rows
  for (int step = 0; step < steps; step++)
    Tiles::template add_product<true, Right>(x + step * GROUP * LANES, LANES, TILE_FLOATS, weights + step * TILE_FLOATS,
                                             LANES, steps * TILE_FLOATS);
  Tiles::template store<true, Right>(sums, width);
}

// sums[GROUP][row_width(outputs)] = x weights + bias, x as terms.
template <class Tiles>
static inline void dense_rows(const RowPanels& layer, const float* x, float* sums) {
  const int width = row_width(layer.outputs), steps = row_steps(layer.inputs);
  before_tile_loads();
  for (int first = 0; first < width; first += 2 * LANES) {
    const float* weights = layer.weights + first / LANES * steps * TILE_FLOATS;
    if (width - first > LANES)
      multiply_rows<Tiles, true>(weights, layer.bias + first, steps, x, sums + first, width);
    else
      multiply_rows<Tiles, false>(weights, layer.bias + first, steps, x, sums + first, width);
  }
}

// values[GROUP][row_steps(count) * STEP_INPUTS], changed by `finish`, as terms.
template <class Terms, class Finish>
static inline void terms_of_rows(const float* values, int count, float* terms, Finish finish) {
  const int steps = row_steps(count), width = steps * STEP_INPUTS;
  for (int step = 0; step < steps; step++)
    for (int i = 0; i < GROUP; i++) {
      const float* from = values + i * width + step * STEP_INPUTS;
      store(terms + (step * GROUP + i) * LANES, Terms::of_neighbours(finish(load(from)), finish(load(from + LANES))));
    }
}

}  // namespace ringlight::RINGLIGHT_ISA
