// Opacities whose logits have harmonics that are a mix of shared ones, by the weights that mix the colours'. The way
// back computes them again; the gradient of what is shared is summed in shards (step/sh_shards.isa.hpp).
#include "machine/parallel.hpp"
#include "machine/scratch.isa.hpp"
#include "step/opacity_rows.isa.hpp"
#include "step/sh_mix.isa.hpp"
#include "step/sh_opacity.hpp"
#include "step/sh_shards.isa.hpp"
#include "step/shared_gradient.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

constexpr std::size_t GRAIN = 64 * LANES;  // rows a piece

// One block's rows, seen from the camera.
struct OpacityBlock {
  Block block;
  alignas(64) Lanes weights[SH_MAX_BASIS];
  Coefficients coefficients;
  Lanes shown, dark;   // sigmoid(logit + harmonics), and what it leaves of one: the difference would lose digits
  Lanes mean, light;   // the same without harmonics
  Lanes over;          // what the factor is divided by
};

struct Opacity {
  Vec value, rest;  // rest is 1 - value, but with all digits
};

RINGLIGHT_INLINE Opacity opacity_of(Vec logit) {
  const Vec odds = exp(-logit), value = Vec(1.f) / (Vec(1.f) + odds);
  return {value, odds * value};
}

void open_opacities(const DirectionalOpacities& table, const SharedBasis& mixed, std::size_t first, std::size_t end,
                    OpacityBlock& found) {
  Block& block = found.block;
  open_block(table.harmonics, first, end, block);
  load_weights(mixed, block, found.weights);
  const Vec logits = load_first(table.logits + first, block.rows);
  mix<OPACITIES_TOGETHER>(mixed, found.weights, block.count, HARMONICS, found.coefficients);
  Vec moved = logits;
  for (int k = 0; k < block.count; k++) moved = fma(load(found.coefficients[k]), load(block.basis[k]), moved);
  const Opacity shown = opacity_of(moved), mean = opacity_of(logits);
  store(found.shown, shown.value);
  store(found.dark, shown.rest);
  store(found.mean, mean.value);
  store(found.light, mean.rest);
  store(found.over, max(Vec(table.least), mean.value));
}

// d(factor) to dL/d(sum of harmonics), and dL/d(logit), which is added: the factor falls as what it is divided by
// rises. A row that nobody saw, or whose opacity is no number, has zeros: it must not reach what all share.
void by_sums(const DirectionalOpacities& table, const float* upstream, const OpacityBlock& of, Lanes by_sum,
             float* logits) {
  const Vec given = load(upstream), shown = load(of.shown), mean = load(of.mean), zero(0.f);
  const Mask unseen = both(ge(given, zero), ge(zero, given)), number = ge(shown, zero);
  const Vec factor = given * shown / load(of.over);
  const Vec rises = select(unseen, zero, keep(number, factor * load(of.dark)));
  const Vec falls = select(unseen, zero, keep(both(number, gt(mean, Vec(table.least))), factor * load(of.light)));
  store(by_sum, rises);
  float* const to = logits + of.block.first;
  store_first(to, load_first(to, of.block.rows) + (rises - falls), of.block.rows);
}

// by_weights[j] += sum of basis[j][k] harmonics[k] by_sum.
void add_to_weights(const SharedBasis& mixed, const Block& block, const Lanes by_sum, float* by_weights) {
  float* const rows = by_weights + static_cast<std::size_t>(mixed.count) * block.first;
  Vec columns[LANES];
  take_columns(rows, mixed.count, block.rows, columns);
  // Four at a time do not wait for each other; the last four repeat the last one.
  for (int j = 0; j < mixed.count; j += 4) {
    const float* basis[4];
    for (int i = 0; i < 4; i++) basis[i] = mixed.basis + HARMONICS * (j + i < mixed.count ? j + i : mixed.count - 1);
    Vec sums[4] = {Vec(0.f), Vec(0.f), Vec(0.f), Vec(0.f)};
    for (int k = 0; k < block.count; k++) {
      const Vec harmonic = load(block.basis[k]);
      for (int i = 0; i < 4; i++) sums[i] = fma(harmonic, Vec(basis[i][k]), sums[i]);
    }
    for (int i = 0; i < 4 && j + i < mixed.count; i++) columns[j + i] = fma(sums[i], load(by_sum), columns[j + i]);
  }
  for (int j = mixed.count; j < LANES; j++) columns[j] = Vec(0.f);
  put_columns(rows, mixed.count, block.rows, columns);
}

// Rows whose gradient is not zero; what is not a number counts.
Mask lit_rows(const Block& block, Vec by_sum) {
  const unsigned rows = (1u << block.rows) - 1;  // surplus lanes repeat the last row
  return mask_from_bits(rows & ~bits(both(ge(by_sum, Vec(0.f)), ge(Vec(0.f), by_sum))));
}

// Blocks that nobody sees cost nothing.
void run_shard(const DirectionalOpacities& table, const SharedBasis& mixed, const float* by_factors, std::size_t shard,
               std::size_t shards, const BasisOpacityGradients& to, float* sums) {
  const std::size_t count = table.harmonics.count;
  const int degree = table.harmonics.degree;
  SharedGradient<1> shared(mixed.count, harmonics_of(degree), sums);
  alignas(64) OpacityBlock found;
  for_blocks_of(shard, shards, count, [&](std::size_t first) __attribute__((always_inline)) {
    Lanes upstream, by_sum[1];
    store(upstream, load_first(by_factors + first, count - first < LANES ? static_cast<int>(count - first) : LANES));
    if (is_zero(upstream)) return;
    open_opacities(table, mixed, first, count, found);
    by_sums(table, upstream, found, by_sum[0], to.logits);
    add_to_means(by_sum[0], degree, found.block, found.coefficients, to.means);
    add_to_weights(mixed, found.block, by_sum[0], to.weights);
    shared.add(lit_rows(found.block, load(by_sum[0])), found.weights, found.block.basis, by_sum);
  });
  shared.flush();
}

}  // namespace

void sh_basis_opacity_factors(const DirectionalOpacities& table, const SharedBasis& mixed, float* factors) {
  parallel_ranges(table.harmonics.count, GRAIN, [&](std::size_t begin, std::size_t end) {
    alignas(64) OpacityBlock found;
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
