#include <cstring>

#include "illuminated/illuminated.hpp"
#include "illuminated/light_network.isa.hpp"
#include "simd/row_columns.isa.hpp"
#include "step/importance_sampling.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

constexpr std::size_t MOST_SHARDS = 8;  // whose sums are added in order: each costs 170 KB to clear and to add

// Sums of a shard: the network's, then the matrix [features][padded(3C)], then the offset by lanes.
std::size_t shard_floats(const LightField& field, const Widths& widths) {
  return sums_size(widths) + weight_sums(field.features, field.joined()) + field.features * LANES;
}

// dL/d(network's results) in lanes: upstream rows [count 3] times the slope of tanh.
void through_result(const float* upstream, int count, const float* results, float* gradient) {
  for (int half = 0; half < GROUP; half += LANES) {
    Vec of_color[LANES];
    const int left = count - half, some = left < LANES ? left : LANES;
    if (some > 0) take_columns(upstream + LIT_WIDTH * half, LIT_WIDTH, some, of_color);
    const Mask there = mask_from_bits(some > 0 ? (1u << some) - 1 : 0u);
    for (int c = 0; c < LIT_WIDTH; c++) {
      const Vec color = tanh_fast(load(results + c * GROUP + half));
      const Vec of_one = some > 0 ? keep(there, of_color[c]) : Vec(0.f);
      store(gradient + c * GROUP + half, of_one * fnma(color, color, Vec(1.f)));
    }
  }
}

// Times the slope of what is a tanh already.
void through_tanh(const float* values, int count, float* gradient) {
  for (int i = 0; i < count * GROUP; i += LANES) {
    const Vec value = load(values + i);
    store(gradient + i, load(gradient + i) * fnma(value, value, Vec(1.f)));
  }
}

// From those of the codes to that of the stored roughness.
void write_roughness(const LitGaussians& lit, const LitLanes& lanes, const float* codes, const float* of_codes,
                     float* to) {
  alignas(64) float found[GROUP];
  for (int half = 0; half < GROUP; half += LANES) {
    Vec sum(0.f);
    int pair = 0;
    for (int level = 1; level <= HIGHEST_LEVEL; level *= 2) {
      Vec of_level(0.f);
      for (int m = 0; m <= level; m++, pair++)
        for (const int c : {pair, CODE_PAIRS + pair})
          of_level = fma(load(codes + c * GROUP + half), load(of_codes + c * GROUP + half), of_level);
      sum = fma(of_level, Vec(-0.5f * level * (level + 1)), sum);
    }
    const Vec stored = gather_numbers(lit.roughness, lanes.rows + half);
    store(found + half, sum * sigmoid(stored - Vec(lit.roughness_shift)));
  }
  for (int i = 0; i < lanes.count; i++) to[lanes.rows[i]] = found[i];
}

// lanes[width][GROUP] to chosen rows.
void scatter_rows(const float* lanes, int width, const LitLanes& to, float* blocks, float* rows) {
  to_rows(lanes, width, blocks);
  for (int first = 0; first < width; first += LANES)
    for (int lane = 0; lane < to.count; lane++)
      store_block(rows + static_cast<std::size_t>(to.rows[lane]) * width + first,
                  load(blocks + (first / LANES * GROUP + lane) * LANES), block_width(width, first));
}

// The field's part: of the matrix, and what the products get.
void mix_gradient(const LightField& field, const LightPanels& panels, const float* products, const float* of_mixed,
                  float* terms, float* blocks, float* sums, float* of_products) {
  const int joined = field.joined(), features = field.features;
  to_rows<LayerTerms>(products, joined, blocks);
  add_layer_gradient<LayerTerms>({sums, sums + weight_sums(features, joined), features, joined}, of_mixed, blocks,
                                 terms);
  dense<LayerTerms>(panels.transposed_mix, feature_terms<LayerTerms>(of_mixed, features, terms), of_products);
}

void write_mix(const LightField& field, const float* sums, std::size_t stride, std::size_t shards,
               const LightGradients& to) {
  const int joined = field.joined(), width = padded(joined);
  const float* const biases = sums + weight_sums(field.features, joined);
  for (int f = 0; f < field.features; f++) {
    for (int j = 0; j < joined; j += LANES) {
      Vec total(0.f);
      for (std::size_t shard = 0; shard < shards; shard++) total += load(sums + shard * stride + f * width + j);
      store_block(to.mix + static_cast<std::size_t>(f) * joined + j, total, block_width(joined, j));
    }
    Vec total(0.f);
    for (std::size_t shard = 0; shard < shards; shard++) total += load(biases + shard * stride + f * LANES);
    to.offset[f] = sum(total);
  }
}

}  // namespace

std::size_t draw_lit_rows(double share, std::size_t count, const float* upstream, std::int32_t* drawn,
                          float* weights) {
  for (std::size_t i = 0; i < count; i++) drawn[i] = static_cast<std::int32_t>(i);
  return sample_by_gradient({upstream, LIT_WIDTH, 1, nullptr}, share, count, drawn, weights);
}

void light_backward(const LightField& field, const LitGaussians& lit, const float* of_specular,
                    const LightGradients& to) {
  const LightPanels panels(field, true);
  const Widths& widths = panels.widths;
  const HeadPanels network = panels.network.of(0, false), transposed = panels.network.of(0, true);
  const std::size_t groups = (lit.count + GROUP - 1) / GROUP, shards = groups < MOST_SHARDS ? groups : MOST_SHARDS;
  const std::size_t size = shard_floats(field, widths), block = panels.block(), joined = field.joined();
  const Scratch sums(size * shards * sizeof(float));
  parallel_for(shards, [&](std::size_t shard) {
    const Scratch memory((2 * SPARE + 4) * block * sizeof(float));
    const MatrixUnit unit;
    const Activations at = lay_out(widths, memory.floats());
    const Activations gradient = lay_out(widths, memory.floats() + SPARE * block);
    float *const products = memory.floats() + 2 * SPARE * block, *const blocks = products + block;
    float* const of_products = blocks + block;
    float* const points = of_products + block;
    float *const own = sums.floats() + shard * size, *const of_mix = own + sums_size(widths);
    std::memset(own, 0, size * sizeof(float));
    for (std::size_t first = shard * groups / shards * GROUP; first < (shard + 1) * groups / shards * GROUP;
         first += GROUP) {
      const LitLanes lanes(lit, first);
      fill_group(field, lit, lanes, products, at.of[0], points);
      std::memcpy(to.points + 3 * first, points, 3 * lanes.count * sizeof(float));
      mix_group(field, panels, products, at.of[0], at.terms);
      evaluate_hidden(network, at);
      evaluate<Result::PLAIN>(network, at, LAYERS - 1);
      through_result(of_specular + LIT_WIDTH * first, lanes.count, at.of[LAYERS], gradient.of[LAYERS]);
      add_gradients(widths, transposed, at, gradient, true, blocks, own);
      float *const of_inputs = gradient.of[0], *const of_mixed = of_inputs + field.features * GROUP;
      const int view = (2 * field.features + 3) * GROUP;
      write_roughness(lit, lanes, at.of[0] + view, of_inputs + view, to.roughness);
      through_tanh(at.of[0], 2 * field.features, of_inputs);
      scatter_rows(of_inputs, field.features, lanes, blocks, to.features);
      mix_gradient(field, panels, products, of_mixed, at.terms, blocks, of_mix, of_products);
      lanes_to_rows(of_products, lanes.count, field.joined(), blocks, to.products + joined * first);
    }
  });
  write_gradients(widths, sums.floats(), size, static_cast<int>(shards), 0, to.layers);
  write_mix(field, sums.floats() + sums_size(widths), size, shards, to);
}

}  // namespace ringlight::RINGLIGHT_ISA
