// One group of Gaussians on its way through the light field: the forward pass with everything that the backward pass
// needs left in place.
#pragma once
#include "dense/lane_layers.isa.hpp"
#include "dense/lane_tables.isa.hpp"
#include "machine/scratch.isa.hpp"
#include "ring/cell_tables.isa.hpp"
#include "ring/lane_matrices.isa.hpp"
#include "ring/ring.hpp"
#include "simd/octahedral.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

// Rank at which a row of a matrix is one Vec, so that the ring is evaluated by rows: product_rows.isa.hpp.
constexpr int ROW_RANK = LANES;
constexpr int MATRIX = ROW_RANK * ROW_RANK;

static inline bool by_rows(const RingShape& shape) {
  return shape.rank == ROW_RANK && !shape.diagonal && !in_tiles<MatrixTerms>(shape);
}

// The dense layers in the order of use, and the tables; these are the parameters' own but for diagonal matrices, and
// those in tiles. `core` is the core's weights in the order of tiles, if matrices are.
struct RingPanels {
  Panels core, modulation[2], render[3];
  CellTables tables;
  const float* core_weights;
};

// [rows][R^2] with each matrix tile after tile.
template <class Terms>
static inline const float* to_tiles(const float* matrices, int rank, int rows, float* to) {
  if constexpr (numbers_of<Terms> == 2)
    for (int row = 0; to && row < rows; row++)
      for (int h = 0; h < rank; h += TILE)
        for (int c = 0; c < rank; c += TILE)
          store(to + row * rank * rank + h * rank + c * TILE,
                Terms::load_quarters(matrices + row * rank * rank + h * rank + c, rank));
  return to;
}

static inline RingPanels pack_layers(const RingShape& shape, const RingParameters<const float>& from, Arena& arena) {
  const auto packed = [&arena](const RingLayer<const float>& layer, int outputs, int inputs) {
    float* to = arena.take(panel_floats<LayerTerms>(outputs, inputs));
    return to ? pack<LayerTerms>(layer.weight, inputs, 1, layer.bias, outputs, inputs, to) : Panels{};
  };
  const int matrix = static_cast<int>(matrix_size(shape)), hidden = shape.render_hidden;
  RingPanels panels;
  const bool tiles = in_tiles<MatrixTerms>(shape);
  if (shape.diagonal || tiles) panels.tables = pack_tables<MatrixTerms>(shape, from, arena);
  panels.core_weights = from.core;
  if (tiles) {
    float* const to = arena.take(static_cast<std::size_t>(shape.features) * matrix);
    panels.core_weights = to_tiles<MatrixTerms>(from.core, shape.rank, shape.features, to);
  }
  panels.core = packed({panels.core_weights, nullptr}, shape.features, matrix);
  if (modulated(shape)) {
    panels.modulation[0] = packed(from.modulation[0], shape.modulation_hidden, modulation_inputs(shape));
    panels.modulation[1] = packed(from.modulation[1], 1, shape.modulation_hidden);
  }
  panels.render[0] = packed(from.render[0], hidden, render_inputs(shape));
  panels.render[1] = packed(from.render[1], hidden, hidden);
  panels.render[2] = packed(from.render[2], 3, hidden);
  return panels;
}

// Sixteen Gaussians' ring: where they fall in the tables, and the matrices [R^2][16], or [16][R^2] by rows, or the
// components [16][padded(R^2)] of diagonal ones.
struct RingHalf {
  Cells axes[3], across, down;
  float *x, *y, *z, *view;  // H_x, H_y, H_z, H_v
  float *xy, *xyz;          // H_x H_y, H_x H_y H_z
};

static inline RingCells cells_of(const RingHalf& ring) { return {ring.axes, &ring.across, &ring.down}; }

struct Batch {
  std::int32_t rows[GROUP];  // of the table of Gaussians; the last one is repeated in an incomplete group
  int count;                 // how many of them count
  bool consecutive;          // whether they are neighbours in the table, as most are where nearly all are visible
  bool keep_ring;            // whether the matrices of all are kept, or overwritten by the next
  RingHalf halves[2];
  float* product;            // H_x H_y H_z H_v, [R^2][GROUP] like everything below; of tiles as terms, [R^2 / 2][GROUP]
  float *packed_products, *transposes;  // of tiles: see product_tiles.isa.hpp
  float* inputs;             // v 3, a C, m 1 (if it is an input), b 3, latents: the networks' inputs overlap
  float *activated, *modulation, *base, *latents;  // a, m, b and latents therein; m elsewhere if it is a factor
  float *modulation_hidden, *render_hidden[2];
  float* residual;           // before m weighs it, where it does
  float* terms;  // a layer's input as its multiply-adds take it
};

// The most values of one Gaussian that enter a layer, or leave one.
static inline int widest_layer(const RingShape& shape) {
  int widest = static_cast<int>(matrix_size(shape));
  const int widths[] = {shape.render_hidden, shape.modulation_hidden, 3 + render_inputs(shape), shape.features};
  for (const int width : widths)
    widest = width > widest ? width : widest;
  return widest;
}

constexpr int TRANSPOSES = 6;  // matrices of each Gaussian that the gradient of tiles needs

// With keep_ring, both halves keep their matrices; else they share the memory.
static inline void lay_out(Batch& batch, const RingShape& shape, bool keep_ring, Arena& arena) {
  const std::size_t matrix = padded(static_cast<int>(matrix_size(shape))) * LANES;
  batch.keep_ring = keep_ring;
  const bool tiles = in_tiles<MatrixTerms>(shape);
  batch.packed_products = tiles ? arena.take(matrix_size(shape) / 2 * GROUP) : nullptr;
  batch.transposes = tiles && keep_ring ? arena.take(TRANSPOSES * matrix_size(shape) / 2 * GROUP) : nullptr;
  for (int half = 0; half < 2 && !tiles; half++) {
    RingHalf& ring = batch.halves[half];
    if (half && !keep_ring) {
      const RingHalf& shared = batch.halves[0];
      ring.x = shared.x, ring.y = shared.y, ring.z = shared.z, ring.view = shared.view;
      ring.xy = shared.xy, ring.xyz = shared.xyz;
      continue;
    }
    float** const matrices[] = {&ring.x, &ring.y, &ring.z, &ring.view, &ring.xy, &ring.xyz};
    for (float** place : matrices) *place = arena.take(matrix);
  }
  batch.product = arena.take(matrix_size(shape) * GROUP);
  batch.inputs = arena.take(static_cast<std::size_t>(GROUP) * (3 + render_inputs(shape)));
  batch.activated = batch.inputs + 3 * GROUP;
  batch.modulation = weighed(shape) ? arena.take(GROUP) : batch.activated + shape.features * GROUP;
  batch.base = batch.activated + base_input(shape) * GROUP;
  batch.latents = batch.base + 3 * GROUP;
  const auto rows = [&arena](int count) { return arena.take(static_cast<std::size_t>(GROUP) * count); };
  batch.modulation_hidden = rows(result_rows(shape.modulation_hidden));
  for (float*& hidden : batch.render_hidden) hidden = rows(result_rows(shape.render_hidden));
  batch.residual = rows(3);
  batch.terms = rows(term_rows<LayerTerms>(widest_layer(shape)));
}

// The group's rows of table[][Width] as columns, [Width][GROUP].
template <int Width>
static inline void gather_narrow(const Batch& batch, const float* table, float* columns) {
  alignas(64) float copies[Width * GROUP];
  const float* rows = table + static_cast<std::size_t>(batch.rows[0]) * Width;
  if (!batch.consecutive) {
    for (int lane = 0; lane < GROUP; lane++)
      __builtin_memcpy(copies + lane * Width, table + static_cast<std::size_t>(batch.rows[lane]) * Width,
                       Width * sizeof(float));
    rows = copies;
  }
  for (int first = 0; first < GROUP; first += LANES) {
    Vec column[Width];
    if constexpr (Width == 3)
      load_columns(rows + first * Width, column[0], column[1], column[2]);
    else
      load_columns(rows + first * Width, column[0], column[1], column[2], column[3]);
    for (int c = 0; c < Width; c++) store(columns + c * GROUP + first, column[c]);
  }
}

// The same for any width.
static inline void gather_columns(const Batch& batch, const float* table, int width, float* columns) {
  if (width == 3) return gather_narrow<3>(batch, table, columns);
  if (width == 4) return gather_narrow<4>(batch, table, columns);
  for (int lane = 0; lane < GROUP; lane++)
    for (int c = 0; c < width; c++)
      columns[c * GROUP + lane] = table[static_cast<std::size_t>(batch.rows[lane]) * width + c];
}

// Gathers the rows: base colour, latents and viewing direction into the networks' inputs, places in the tables.
static inline void start(Batch& batch, const RingShape& shape, const RingScene& scene, const std::int32_t* rows,
                         int count) {
  batch.count = count;
  batch.consecutive = true;
  for (int lane = 0; lane < GROUP; lane++) {
    batch.rows[lane] = rows[lane < count ? lane : count - 1];
    batch.consecutive &= batch.rows[lane] == batch.rows[0] + lane;
  }
  alignas(64) float means[3 * GROUP];
  gather_columns(batch, scene.means, 3, means);
  gather_columns(batch, scene.base, 3, batch.base);
  gather_columns(batch, scene.latents, shape.latents, batch.latents);
  for (int half = 0; half < 2; half++) {
    const int first = half * LANES;
    Vec offset[3], squared(0.f);
    for (int c = 0; c < 3; c++) {
      float* base = batch.base + c * GROUP + first;
      store(base, sigmoid(load(base)));
      const Vec mean = load(means + c * GROUP + first);
      const Vec scale(2.f / (scene.high[c] - scene.low[c]));
      locate((mean - Vec(scene.low[c])) * scale - Vec(1.f), shape.nodes, batch.halves[half].axes[c]);
      offset[c] = mean - Vec(scene.camera[c]);
      squared = fma(offset[c], offset[c], squared);
    }
    const Vec inverse = Vec(1.f) / sqrt(max(squared, Vec(convention::SMALLEST_LENGTH * convention::SMALLEST_LENGTH)));
    for (int c = 0; c < 3; c++) {
      offset[c] = offset[c] * inverse;
      store(batch.inputs + c * GROUP + first, offset[c]);
    }
    const OctahedralPoint at = octahedral(offset);
    locate(at.u, shape.view_nodes, batch.halves[half].across);
    locate(at.v, shape.view_nodes, batch.halves[half].down);
  }
}

// The ring's product for both halves.
static inline void multiply_ring(Batch& batch, const RingShape& shape, const RingParameters<const float>& parameters) {
  const int rank = shape.rank, width = rank * rank;
  const auto matrix = [rank](float* values) { return LaneMatrix<float>{values, rank * LANES, LANES}; };
  const auto read_only = [rank](const float* values) {
    return LaneMatrix<const float>{values, rank * LANES, LANES};
  };
  for (int half = 0; half < 2; half++) {
    RingHalf& ring = batch.halves[half];
    float* const heads[3] = {ring.x, ring.y, ring.z};
    for (int axis = 0; axis < 3; axis++)
      read_table(AxisTable{width, ring.axes[axis]}, parameters.axes + axis * axis_size(shape), heads[axis]);
    read_table(MapTable{width, shape.view_nodes, ring.across, ring.down}, parameters.view, ring.view);
    product(rank, read_only(ring.x), read_only(ring.y), matrix(ring.xy));
    product(rank, read_only(ring.xy), read_only(ring.z), matrix(ring.xyz));
    product(rank, read_only(ring.xyz), read_only(ring.view), {batch.product + half * LANES, rank * GROUP, GROUP});
  }
}

static inline void apply(const Panels& layer, const float* from, float* terms, float* to) {
  dense<LayerTerms>(layer, feature_terms<LayerTerms>(from, layer.inputs, terms), to);
}

// A hidden layer of `terms`. With Keep its activations are numbers in `to`; else they are terms already.
template <bool Keep>
static inline const float* hidden_layer(const Panels& layer, const float* terms, float* buffer, float* to) {
  if constexpr (Keep) {
    dense<LayerTerms, Result::RECTIFIED>(layer, terms, to);
    return feature_terms<LayerTerms>(to, layer.outputs, buffer);
  } else {
    dense<LayerTerms, Result::RECTIFIED_TERMS>(layer, terms, to);
    return to;
  }
}

// From the ring's product to the residual colour. With Keep the hidden layers' activations are left for the gradient.
template <bool Keep>
static inline void shade(Batch& batch, const RingShape& shape, const RingPanels& panels) {
  const auto terms = [&batch](const float* x, int count) { return feature_terms<LayerTerms>(x, count, batch.terms); };
  const auto hidden = [&batch](const Panels& layer, const float* from, float* to) {
    return hidden_layer<Keep>(layer, from, batch.terms, to);
  };
  const bool ready = in_tiles<MatrixTerms>(shape);
  dense<LayerTerms>(panels.core, ready ? batch.product : terms(batch.product, panels.core.inputs), batch.activated);
  for (int i = 0; i < shape.features * GROUP; i += LANES)
    store(batch.activated + i, tanh_fast(load(batch.activated + i)));
  if (modulated(shape)) {
    const Panels* layers = panels.modulation;
    const float* const unit = hidden(layers[0], terms(batch.inputs, layers[0].inputs), batch.modulation_hidden);
    dense<LayerTerms>(layers[1], unit, batch.modulation);
    for (int i = 0; i < GROUP; i += LANES) store(batch.modulation + i, sigmoid(load(batch.modulation + i)));
  }
  const float* from = terms(batch.activated, panels.render[0].inputs);
  for (int layer = 0; layer < 2; layer++) from = hidden(panels.render[layer], from, batch.render_hidden[layer]);
  dense<LayerTerms>(panels.render[2], from, batch.residual);
  for (int i = 0; i < 3 * GROUP; i += LANES) store(batch.residual + i, tanh_fast(load(batch.residual + i)));
}

}  // namespace ringlight::RINGLIGHT_ISA
