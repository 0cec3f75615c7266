// The gradient of harmonics that are a mix of shared ones: by each Gaussian's weights, and by what is shared, which is
// a sum over all Gaussians. It is taken in a fixed number of shards, which are added in order: the same bits for any
// number of threads.
#include <cstring>

#include "machine/parallel.hpp"
#include "machine/scratch.isa.hpp"
#include "step/sh_mix.isa.hpp"
#include "step/sh_shards.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

// dL/d(colour) of the block, planar, and the lanes that got any, lane i as bit i; what is not a number counts.
unsigned find_gradient(const float* by_constant, const Block& block, Lanes* by_sum) {
  load_triples(by_constant, block, by_sum);
  const unsigned rows = (1u << block.rows) - 1;  // surplus lanes repeat the last row
  unsigned lit = 0;
  for (int c = 0; c < 3; c++) {
    const Vec sum = keep(mask_from_bits(rows), load(by_sum[c]) * Vec(1 / C0));
    store(by_sum[c], sum);
    lit |= ~bits(both(ge(sum, Vec(0.f)), ge(Vec(0.f), sum))) & rows;
  }
  return lit;
}

// by_weights[j] = sum of basis[j][k][c] harmonics[k] by_sum[c].
void weights_gradient(const SharedBasis& mixed, const Block& block, const Lanes* by_sum, float* by_weights) {
  Vec planar[LANES];
  for (int j = mixed.count; j < LANES; j++) planar[j] = Vec(0.f);
  // Two at a time: a sum waits for the one before it, six do not wait for each other.
  for (int j = 0; j < mixed.count; j += 2) {
    const int other = j + 1 < mixed.count ? j + 1 : j;
    const float *const one = mixed.basis + SH_REST * j, *const two = mixed.basis + SH_REST * other;
    Vec seen[2][3] = {{Vec(0.f), Vec(0.f), Vec(0.f)}, {Vec(0.f), Vec(0.f), Vec(0.f)}};
    for (int k = 0; k < block.count; k++) {
      const Vec harmonic = load(block.basis[k]);
      for (int c = 0; c < 3; c++) {
        seen[0][c] = fma(harmonic, Vec(one[3 * k + c]), seen[0][c]);
        seen[1][c] = fma(harmonic, Vec(two[3 * k + c]), seen[1][c]);
      }
    }
    const int places[] = {j, other};
    for (int i = 0; i < 2; i++) {
      Vec sum = seen[i][0] * load(by_sum[0]);
      for (int c = 1; c < 3; c++) sum = fma(seen[i][c], load(by_sum[c]), sum);
      planar[places[i]] = sum;
    }
  }
  put_columns(by_weights + static_cast<std::size_t>(mixed.count) * block.first, mixed.count, block.rows, planar);
}

// sums[j][k][c][lane] += weights[j] harmonics[k] by_sum[c].
void add_basis_gradient(const SharedBasis& mixed, const Block& block, Mask lit, const Lanes* by_sum, float* sums) {
  alignas(64) Lanes weights[convention::SH_MAX_BASIS];
  load_weights(mixed, block, weights);
  for (int j = 0; j < mixed.count; j++)
    for (int c = 0; c < 3; c++) {
      const Vec factor = keep(lit, load(weights[j])) * load(by_sum[c]);
      float* const to = sums + (SH_REST * j + c) * LANES;
      for (int k = 0; k < block.count; k++) {
        float* const sum = to + 3 * k * LANES;
        store(sum, fma(load(block.basis[k]), factor, load(sum)));
      }
    }
}

// Every `shards`-th block from `shard` on: blocks that nobody sees are neighbours, and cost nothing.
void run_shard(const Harmonics& table, const SharedBasis& mixed, const float* by_constant, std::size_t shard,
               std::size_t shards, float* by_weights, float* sums) {
  std::memset(sums, 0, SH_REST * LANES * sizeof(float) * mixed.count);
  Block block;
  for (std::size_t first = shard * LANES; first < table.count; first += shards * LANES) {
    Lanes by_sum[3];
    block.first = first;
    block.rows = table.count - first < LANES ? static_cast<int>(table.count - first) : LANES;
    const unsigned lit = find_gradient(by_constant, block, by_sum);
    if (!lit) {
      std::memset(by_weights + mixed.count * first, 0, sizeof(float) * mixed.count * block.rows);
      continue;
    }
    open_block(table, first, table.count, block);
    // Rows that got no gradient must not reach the sums, which all share, even if they are not numbers.
    const Mask lanes = mask_from_bits(lit);
    for (int k = 0; k < block.count; k++) store(block.basis[k], keep(lanes, load(block.basis[k])));
    weights_gradient(mixed, block, by_sum, by_weights);
    add_basis_gradient(mixed, block, lanes, by_sum, sums);
  }
}

}  // namespace

void sh_basis_gradient(const Harmonics& table, const SharedBasis& mixed, const float* by_constant, float* by_weights,
                       float* by_basis) {
  const std::size_t shards = shards_of((table.count + LANES - 1) / LANES);
  const std::size_t width = static_cast<std::size_t>(SH_REST) * mixed.count;
  const Scratch memory(shards * width * LANES * sizeof(float));  // a vector for each number of each shard
  float* const sums = memory.floats();
  parallel_for(shards, [&](std::size_t shard) {
    run_shard(table, mixed, by_constant, shard, shards, by_weights, sums + shard * width * LANES);
  });
  add_shards(sums, shards, width, by_basis);
}

}  // namespace ringlight::RINGLIGHT_ISA
