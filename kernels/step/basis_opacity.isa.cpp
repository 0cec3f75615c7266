// Opacities whose logits have harmonics that are a mix of shared ones, by the weights that mix the colours'. The way
// back computes them again; the gradient of what is shared is summed in shards (step/sh_shards.isa.hpp).
#include <cstring>

#include "machine/parallel.hpp"
#include "machine/scratch.isa.hpp"
#include "step/opacity_rows.isa.hpp"
#include "step/sh_mix.isa.hpp"
#include "step/sh_opacity.hpp"
#include "step/sh_shards.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

constexpr std::size_t GRAIN = 64 * LANES;  // rows a piece

// One block's rows, seen from the camera.
struct Opacities {
  Block block;
  alignas(64) Lanes weights[convention::SH_MAX_BASIS];
  Coefficients coefficients;
  Lanes shown, dark;   // sigmoid(logit + harmonics), and what it leaves of one: the difference would lose digits
  Lanes mean, light;   // the same without harmonics
  Lanes over;          // what the factor is divided by
};

void open_opacities(const DirectionalOpacities& table, const SharedBasis& mixed, std::size_t first, std::size_t end,
                    Opacities& found) {
  Block& block = found.block;
  open_block(table.harmonics, first, end, block);
  load_weights(mixed, block, found.weights);
  const Vec logits = load_first(table.logits + first, block.rows);
  Vec moved = logits;
  for (int k = 0; k < block.count; k++) {
    Vec sum = load(found.weights[0]) * Vec(mixed.basis[k]);
    for (int j = 1; j < mixed.count; j++) sum = fma(load(found.weights[j]), Vec(mixed.basis[HARMONICS * j + k]), sum);
    store(found.coefficients[k], sum);
    moved = fma(sum, load(block.basis[k]), moved);
  }
  store(found.shown, sigmoid(moved));
  store(found.dark, sigmoid(-moved));
  store(found.mean, sigmoid(logits));
  store(found.light, sigmoid(-logits));
  for (int i = 0; i < LANES; i++) found.over[i] = found.mean[i] > table.least ? found.mean[i] : table.least;
}

// d(factor) to dL/d(sum of harmonics), and dL/d(logit), which is added: the factor falls as what it is divided by
// rises. A row that nobody saw, or whose opacity is no number, has zeros: it must not reach what all share.
void by_sums(const DirectionalOpacities& table, const float* upstream, const Opacities& of, Lanes by_sum,
             float* logits) {
  Lanes by_logit;
  for (int i = 0; i < LANES; i++) {
    const bool counts = upstream[i] != 0 && of.shown[i] >= 0;
    const float factor = counts ? upstream[i] * of.shown[i] / of.over[i] : 0.0f;
    by_sum[i] = counts ? factor * of.dark[i] : 0.0f;
    by_logit[i] = by_sum[i] - (of.mean[i] > table.least ? factor * of.light[i] : 0.0f);
  }
  float* const to = logits + of.block.first;
  store_first(to, load_first(to, of.block.rows) + load(by_logit), of.block.rows);
}

// by_weights[j] += sum of basis[j][k] harmonics[k] by_sum.
void add_to_weights(const SharedBasis& mixed, const Block& block, const Lanes by_sum, float* by_weights) {
  float* const rows = by_weights + static_cast<std::size_t>(mixed.count) * block.first;
  Vec columns[LANES];
  take_columns(rows, mixed.count, block.rows, columns);
  for (int j = 0; j < mixed.count; j++) {
    Vec sum(0.f);
    for (int k = 0; k < block.count; k++) sum = fma(load(block.basis[k]), Vec(mixed.basis[HARMONICS * j + k]), sum);
    columns[j] = fma(sum, load(by_sum), columns[j]);
  }
  for (int j = mixed.count; j < LANES; j++) columns[j] = Vec(0.f);
  put_columns(rows, mixed.count, block.rows, columns);
}

// sums[j][k][lane] += weights[j] harmonics[k] by_sum. Rows of zero must not reach the sums, even if they are not
// numbers.
void add_to_shared(const SharedBasis& mixed, const Opacities& of, const Lanes by_sum, float* sums) {
  const Vec upstream = load(by_sum);
  unsigned rows = (1u << of.block.rows) - 1;  // surplus lanes repeat the last row
  rows &= ~bits(both(ge(upstream, Vec(0.f)), ge(Vec(0.f), upstream)));
  const Mask lit = mask_from_bits(rows);
  Lanes seen[HARMONICS];
  for (int k = 0; k < of.block.count; k++) store(seen[k], keep(lit, load(of.block.basis[k])) * keep(lit, upstream));
  for (int j = 0; j < mixed.count; j++) {
    const Vec weight = keep(lit, load(of.weights[j]));
    float* const to = sums + HARMONICS * j * LANES;
    for (int k = 0; k < of.block.count; k++) store(to + k * LANES, fma(weight, load(seen[k]), load(to + k * LANES)));
  }
}

// Every `shards`-th block from `shard` on: blocks that nobody sees are neighbours, and cost nothing.
void run_shard(const DirectionalOpacities& table, const SharedBasis& mixed, const float* by_factors, std::size_t shard,
               std::size_t shards, const BasisOpacityGradients& to, float* sums) {
  const std::size_t count = table.harmonics.count;
  std::memset(sums, 0, HARMONICS * LANES * sizeof(float) * mixed.count);
  alignas(64) Opacities found;
  for (std::size_t first = shard * LANES; first < count; first += shards * LANES) {
    Lanes upstream, by_sum;
    store(upstream, load_first(by_factors + first, count - first < LANES ? static_cast<int>(count - first) : LANES));
    if (is_zero(upstream)) continue;
    open_opacities(table, mixed, first, count, found);
    by_sums(table, upstream, found, by_sum, to.logits);
    add_to_means(by_sum, table.harmonics.degree, found.block, found.coefficients, to.means);
    add_to_weights(mixed, found.block, by_sum, to.weights);
    add_to_shared(mixed, found, by_sum, sums);
  }
}

}  // namespace

void sh_basis_opacity_factors(const DirectionalOpacities& table, const SharedBasis& mixed, float* factors) {
  parallel_ranges(table.harmonics.count, GRAIN, [&](std::size_t begin, std::size_t end) {
    alignas(64) Opacities found;
    for (std::size_t first = begin; first < end; first += LANES) {
      open_opacities(table, mixed, first, end, found);
      store_first(factors + first, load(found.shown) / load(found.over), found.block.rows);
    }
  });
}

void sh_basis_opacity_gradient(const DirectionalOpacities& table, const SharedBasis& mixed, const float* by_factors,
                               const BasisOpacityGradients& to) {
  const std::size_t shards = shards_of((table.harmonics.count + LANES - 1) / LANES);
  const std::size_t width = static_cast<std::size_t>(HARMONICS) * mixed.count;
  const Scratch memory(shards * width * LANES * sizeof(float));  // a vector for each number of each shard
  float* const sums = memory.floats();
  parallel_for(shards, [&](std::size_t shard) {
    run_shard(table, mixed, by_factors, shard, shards, to, sums + shard * width * LANES);
  });
  add_shards(sums, shards, width, to.basis);
}

}  // namespace ringlight::RINGLIGHT_ISA
