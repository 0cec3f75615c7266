// The backward pass of the light field. Rows whose colour got no gradient, because something opaque is in front of
// them, are skipped: their part is exactly zero. The others are importance-sampled and dealt to a fixed number of
// shards, each with sums of its own, which are added in order: the same bits for any number of threads.
#include <cstring>

#include "machine/parallel.hpp"
#include "machine/scratch.isa.hpp"
#include "ring/batch.isa.hpp"
#include "ring/product.isa.hpp"
#include "ring/ring.hpp"
#include "ring/sums.isa.hpp"
#include "step/importance_sampling.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

constexpr std::size_t BASE_GRAIN = 16384;  // floats a piece of the base colours

// The transposed layers: from the gradient of what a layer returned to that of what it was given.
struct GradientPanels {
  Panels core, modulation[2], render[3];
};

GradientPanels pack_transposed(const RingShape& shape, const RingParameters<const float>& from, const float* core,
                               Arena& arena) {
  const auto packed = [&](const float* weight, int outputs, int inputs, int skipped) {
    float* to = arena.take(panel_floats<LayerTerms>(inputs - skipped, outputs));
    return to ? pack<LayerTerms>(weight + skipped, 1, inputs, nullptr, inputs - skipped, outputs, to) : Panels{};
  };
  const int hidden = shape.render_hidden;
  GradientPanels panels;
  panels.core = packed(core, shape.features, static_cast<int>(matrix_size(shape)), 0);
  if (modulated(shape)) {
    // the direction's gradient is not wanted
    panels.modulation[0] = packed(from.modulation[0].weight, shape.modulation_hidden, modulation_inputs(shape), 3);
    panels.modulation[1] = packed(from.modulation[1].weight, 1, shape.modulation_hidden, 0);
  }
  panels.render[0] = packed(from.render[0].weight, hidden, render_inputs(shape), 0);
  panels.render[1] = packed(from.render[1].weight, hidden, hidden, 0);
  panels.render[2] = packed(from.render[2].weight, 3, hidden, 0);
  return panels;
}

// Gradients of a group, [n][GROUP]; `rows` is a layer's input as to_rows leaves it.
struct BatchGradient {
  float *color, *base, *hidden[2], *inputs, *features, *product, *rows;
  float* modulation;  // of m as a factor
  float* terms;  // a gradient as multiply-adds take it
  float *left, *right, *result;  // matrices of the ring, [R^2][16]; left and right as one of [R^2][GROUP]
};

void lay_out_gradient(BatchGradient& gradient, const RingShape& shape, Arena& arena) {
  const std::size_t matrix = matrix_size(shape);
  const std::size_t hidden = shape.render_hidden > shape.modulation_hidden ? shape.render_hidden
                                                                           : shape.modulation_hidden;
  const std::size_t inputs = 3 + render_inputs(shape), widest = widest_layer(shape);
  gradient.color = arena.take(3 * GROUP);
  gradient.base = arena.take(3 * GROUP);
  gradient.modulation = arena.take(GROUP);
  for (float*& place : gradient.hidden) place = arena.take(hidden * GROUP);
  gradient.inputs = arena.take(inputs * GROUP);
  gradient.features = arena.take(static_cast<std::size_t>(shape.features) * GROUP);
  gradient.product = arena.take(matrix * GROUP);
  gradient.rows = arena.take(padded(static_cast<int>(widest)) * static_cast<std::size_t>(GROUP));
  gradient.terms = arena.take(static_cast<std::size_t>(result_rows(static_cast<int>(widest))) * GROUP);
  float** const matrices[] = {&gradient.left, &gradient.right, &gradient.result};
  for (float** place : matrices) *place = arena.take(matrix * LANES);
}

struct Backward {
  const RingShape& shape;
  const RingParameters<const float>& parameters;
  const RingScene& scene;
  RingPanels panels;
  GradientPanels transposed;
  ColorGradient of_colors;
  const std::int32_t* rows;  // that were drawn
  const float* weights;      // what each counts
  RingRowGradients row_gradients;
};

// Adds to a layer's sums, given dL/d(its result) and its input, and leaves dL/d(its input) in `of_input`.
void layer_gradient(const LayerSums& sums, const Panels& transposed, const float* of_result, const float* input,
                    const BatchGradient& gradient, float* of_input) {
  to_rows<LayerTerms>(input, sums.inputs, gradient.rows);
  add_layer_gradient<LayerTerms>(sums, of_result, gradient.rows, gradient.terms);
  apply(transposed, of_result, gradient.terms, of_input);
}

// Where m weighs the residual r: it has the gradient sum of r dL/dcolor, and r's is weighed.
void weigh_gradient(const Batch& batch, const float* counts, BatchGradient& gradient) {
  for (int i = 0; i < GROUP; i += LANES) {
    Vec sum(0.f);
    for (int c = 0; c < 3; c++) {
      const int at = c * GROUP + i;
      sum = fma(load(batch.residual + at), load(gradient.base + at), sum);
      store(gradient.color + at, load(gradient.color + at) * load(batch.modulation + i));
    }
    store(gradient.modulation + i, sum * load(counts + i));
  }
}

// dL/dcolor of the group, zero in lanes that do not count, to what base and residual get of it, and to
// dL/d(render's output), by what the rows count.
void start_gradient(const Backward& pass, const Batch& batch, const float* weights, BatchGradient& gradient) {
  alignas(64) float counts[GROUP];
  for (int lane = 0; lane < GROUP; lane++) counts[lane] = lane < batch.count ? weights[lane] : 0.f;
  for (int c = 0; c < 3; c++)
    for (int lane = 0; lane < GROUP; lane++)
      gradient.base[c * GROUP + lane] = lane < batch.count ? pass.of_colors(batch.rows[lane], c) : 0.f;
  for (int i = 0; i < 3 * GROUP; i += LANES) {
    const Vec residual = load(batch.residual + i), slope = fnma(residual, residual, Vec(1.f));
    store(gradient.color + i, load(gradient.base + i) * load(counts + i % GROUP) * slope);
  }
  if (weighed(pass.shape)) weigh_gradient(batch, counts, gradient);
}

// Through the render network; leaves dL/d(a, m, b, l) in gradient.inputs.
void render_gradient(const Backward& pass, const Batch& batch, BatchGradient& gradient, const ShardSums& sums) {
  const int hidden = pass.shape.render_hidden;
  const float* of_output = gradient.color;
  for (int layer = 2; layer > 0; layer--) {
    layer_gradient(sums.render[layer], pass.transposed.render[layer], of_output, batch.render_hidden[layer - 1],
                   gradient, gradient.hidden[layer - 1]);
    rectify_gradient(gradient.hidden[layer - 1], batch.render_hidden[layer - 1], hidden);
    of_output = gradient.hidden[layer - 1];
  }
  layer_gradient(sums.render[0], pass.transposed.render[0], of_output, batch.activated, gradient, gradient.inputs);
}

// Adds the light modulation's part to dL/da in gradient.inputs.
void modulation_gradient(const Backward& pass, const Batch& batch, BatchGradient& gradient, const ShardSums& sums) {
  const RingShape& shape = pass.shape;
  float* of_scalar = weighed(shape) ? gradient.modulation : gradient.inputs + shape.features * GROUP;
  for (int i = 0; i < GROUP; i += LANES) {
    const Vec m = load(batch.modulation + i);
    store(of_scalar + i, load(of_scalar + i) * m * (Vec(1.f) - m));
  }
  float* of_hidden = gradient.hidden[0];
  layer_gradient(sums.modulation[1], pass.transposed.modulation[1], of_scalar, batch.modulation_hidden, gradient,
                 of_hidden);
  rectify_gradient(of_hidden, batch.modulation_hidden, shape.modulation_hidden);
  layer_gradient(sums.modulation[0], pass.transposed.modulation[0], of_hidden, batch.inputs, gradient,
                 gradient.features);
  for (int i = 0; i < shape.features * GROUP; i += LANES)
    store(gradient.inputs + i, load(gradient.inputs + i) + load(gradient.features + i));
}

// From dL/d(H_x H_y H_z H_v) to the tables, sixteen Gaussians at a time.
void ring_gradient(const Backward& pass, const Batch& batch, BatchGradient& gradient, const ShardSums& sums) {
  const int rank = pass.shape.rank, width = rank * rank;
  const auto matrix = [rank](const float* values) {
    return LaneMatrix<const float>{values, rank * LANES, LANES};
  };
  const auto result = [rank](float* values) { return LaneMatrix<float>{values, rank * LANES, LANES}; };
  for (int half = 0; half < 2; half++) {
    const RingHalf& ring = batch.halves[half];
    const auto scatter = [&](int axis, const float* lanes) {
      add_to_table(AxisTable{width, ring.axes[axis]}, sums.axes + axis * axis_size(pass.shape), lanes);
    };
    const LaneMatrix<const float> of_product{gradient.product + half * LANES, rank * GROUP, GROUP};
    product(rank, matrix(ring.xyz).transposed(), of_product, result(gradient.result));
    add_to_table(MapTable{width, pass.shape.view_nodes, ring.across, ring.down}, sums.view, gradient.result);
    product(rank, of_product, matrix(ring.view).transposed(), result(gradient.left));
    product(rank, matrix(ring.xy).transposed(), matrix(gradient.left), result(gradient.result));
    scatter(2, gradient.result);
    product(rank, matrix(gradient.left), matrix(ring.z).transposed(), result(gradient.right));
    product(rank, matrix(ring.x).transposed(), matrix(gradient.right), result(gradient.result));
    scatter(1, gradient.result);
    product(rank, matrix(gradient.right), matrix(ring.y).transposed(), result(gradient.result));
    scatter(0, gradient.result);
  }
}

void write_row_gradients(const Backward& pass, const Batch& batch, BatchGradient& gradient) {
  const float* of_input = gradient.inputs + base_input(pass.shape) * GROUP;
  const float* of_latents = of_input + 3 * GROUP;
  for (int i = 0; i < 3 * GROUP; i += LANES) {
    const Vec base = load(batch.base + i);
    store(gradient.base + i, (load(gradient.base + i) + load(of_input + i)) * base * (Vec(1.f) - base));
  }
  for (int lane = 0; lane < batch.count; lane++) {
    const std::size_t row = batch.rows[lane];
    for (int c = 0; c < 3; c++) pass.row_gradients.base[3 * row + c] = gradient.base[c * GROUP + lane];
    for (int i = 0; i < pass.shape.latents; i++)
      pass.row_gradients.latents[pass.shape.latents * row + i] = of_latents[i * GROUP + lane];
  }
}

// From dL/d(core's result), in gradient.features, to dL/d(product).
void core_gradient(const Backward& pass, const Batch& batch, BatchGradient& gradient, const ShardSums& sums) {
  const bool done = with_tiles<MatrixTerms>(
      pass.shape, [&](auto rank) { product_rows<MatrixTerms, decltype(rank)::VALUE>(batch, gradient.rows); });
  if (!done) to_rows<LayerTerms>(batch.product, sums.core.inputs, gradient.rows);
  add_layer_gradient<LayerTerms>(sums.core, gradient.features, gradient.rows, gradient.terms);
  apply(pass.transposed.core, gradient.features, gradient.terms, gradient.product);
}

void backpropagate(const Backward& pass, Batch& batch, const float* weights, BatchGradient& gradient,
                   const ShardSums& sums) {
  const RingShape& shape = pass.shape;
  start_gradient(pass, batch, weights, gradient);
  render_gradient(pass, batch, gradient, sums);
  write_row_gradients(pass, batch, gradient);
  if (modulated(shape)) modulation_gradient(pass, batch, gradient, sums);
  for (int i = 0; i < shape.features * GROUP; i += LANES) {
    const Vec activated = load(batch.activated + i);
    store(gradient.features + i, load(gradient.inputs + i) * fnma(activated, activated, Vec(1.f)));
  }
  core_gradient(pass, batch, gradient, sums);
  const bool done = with_tiles<MatrixTerms>(shape, [&](auto rank) {
    ring_gradient_tiles<MatrixTerms, decltype(rank)::VALUE>(batch, shape, gradient.product, sums, gradient.left);
  });
  if (done) return;
  if (!shape.diagonal && !by_rows(shape)) return ring_gradient(pass, batch, gradient, sums);
  for (int half = 0; half < 2; half++) {
    const float* of_product = gradient.product + half * LANES;
    if (shape.diagonal)
      ring_gradient_diagonal(batch.halves[half], shape, pass.panels.tables, of_product, sums);
    else
      ring_gradient_rows(batch.halves[half], shape, of_product, sums, gradient.left, gradient.right);
  }
}

// As if the residual were a constant: right for every row that is not lit, for those that were not drawn the part that
// does not go by the light, and zero where the colour got no gradient.
void write_unlit_gradients(const RingShape& shape, const RingScene& scene, const RingUpstream& upstream,
                           const RingRowGradients& to) {
  const std::size_t latents = shape.latents * scene.count;
  if (latents) std::memset(to.latents, 0, latents * sizeof(float));
  float* const base_gradient = to.base;
  const bool clamped = shape.clamped;
  parallel_ranges(3 * scene.count, BASE_GRAIN, [=](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; i += LANES) {
      const int count = end - i < LANES ? static_cast<int>(end - i) : LANES;
      const Vec base = sigmoid(load_first(scene.base + i, count)), color = load_first(upstream.color + i, count);
      const Mask on = both(gt(color, Vec(0.f)), gt(Vec(1.f), color));
      const Vec given = load_first(upstream.color_gradient + i, count), passed = clamped ? keep(on, given) : given;
      store_first(base_gradient + i, passed * base * (Vec(1.f) - base), count);
    }
  });
}

void run_shard(const Backward& pass, std::size_t begin, std::size_t end, float* zeroed) {
  Arena memory{zeroed};
  const ShardSums sums = lay_out_sums(pass.shape, memory);
  std::memset(zeroed, 0, memory.used * sizeof(float));
  Batch batch;
  BatchGradient gradient;
  Arena needed{nullptr};
  lay_out(batch, pass.shape, true, needed);
  lay_out_gradient(gradient, pass.shape, needed);
  const Scratch own(needed.used * sizeof(float));
  Arena scratch{own.floats()};
  lay_out(batch, pass.shape, true, scratch);
  lay_out_gradient(gradient, pass.shape, scratch);
  const MatrixUnit unit;
  for (std::size_t first = begin; first < end; first += GROUP) {
    const int count = end - first < GROUP ? static_cast<int>(end - first) : GROUP;
    start(batch, pass.shape, pass.scene, pass.rows + first, count);
    multiply<true>(batch, pass.shape, pass.parameters, pass.panels.tables);
    shade<true>(batch, pass.shape, pass.panels);
    backpropagate(pass, batch, pass.weights + first, gradient, sums);
  }
}

// Parts of the workspace beside the shards: the rows that were drawn, what each counts, and the packed weights.
struct Parts {
  std::int32_t* rows;
  float* weights;
  Arena panels;
};

Parts parts_of(const RingShape& shape, std::size_t visible_count, Arena& memory) {
  auto* rows = reinterpret_cast<std::int32_t*>(memory.take(visible_count));
  float* weights = memory.take(visible_count);
  Arena counter{nullptr};
  pack_layers(shape, {}, counter);
  pack_transposed(shape, {}, nullptr, counter);
  return {rows, weights, {memory.take(counter.used)}};
}

}  // namespace

std::size_t ring_workspace(const RingShape& shape, std::size_t visible_count) {
  Arena memory{nullptr}, of_shard{nullptr};
  parts_of(shape, visible_count, memory);
  lay_out_sums(shape, of_shard);
  return memory.used + of_shard.used * ring_shards(visible_count);
}

void ring_backward(const RingShape& shape, const RingParameters<const float>& parameters, const RingScene& scene,
                   const RingUpstream& upstream, const RingParameters<float>& gradients,
                   const RingRowGradients& row_gradients, float* workspace) {
  write_unlit_gradients(shape, scene, upstream, row_gradients);
  Arena memory{workspace};
  Parts parts = parts_of(shape, scene.visible_count, memory);
  // Nothing may be copied from no address, not even no bytes.
  if (scene.visible_count) std::memcpy(parts.rows, scene.visible, scene.visible_count * sizeof *parts.rows);
  const ColorGradient of_colors{upstream.color_gradient, 3, 1, shape.clamped ? upstream.color : nullptr};
  const std::size_t count =
      sample_by_gradient(of_colors, upstream.share, scene.visible_count, parts.rows, parts.weights);
  const RingPanels panels = pack_layers(shape, parameters, parts.panels);
  const GradientPanels transposed = pack_transposed(shape, parameters, panels.core_weights, parts.panels);
  const Backward pass{shape,     parameters,   scene,           panels,       transposed,
                      of_colors, parts.rows, parts.weights, row_gradients};
  Arena of_shard{nullptr};
  lay_out_sums(shape, of_shard);
  const int shards = ring_shards(count);
  float* const sums = memory.take(of_shard.used * shards);
  const std::size_t share = (count + shards - 1) / shards;
  parallel_for(shards, [&](std::size_t shard) {
    const std::size_t begin = shard * share, end = begin + share < count ? begin + share : count;
    run_shard(pass, begin, end, sums + shard * of_shard.used);
  });
  add_up_shards(shape, {sums, of_shard.used, shards}, gradients);
}

}  // namespace ringlight::RINGLIGHT_ISA
