// The gradient of harmonics that are a mix of shared ones: by each Gaussian's weights, and by what is shared, which is
// a sum over all Gaussians. It is taken in a fixed number of shards, which are added in order: the same bits for any
// number of threads.
#include <cstring>

#include "machine/parallel.hpp"
#include "machine/scratch.isa.hpp"
#include "step/sh_mix.isa.hpp"
#include "step/sh_shards.isa.hpp"
#include "step/shared_gradient.isa.hpp"

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

// by_weights[j] = sum of basis[j][k][c] harmonics[k] by_sum[c] of the rows that are `lit`, and 0 of others.
void weights_gradient(const SharedBasis& mixed, const Block& block, Mask lit, const Lanes* by_sum, float* by_weights) {
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
      planar[places[i]] = keep(lit, sum);
    }
  }
  put_columns(by_weights + static_cast<std::size_t>(mixed.count) * block.first, mixed.count, block.rows, planar);
}

// Blocks that nobody sees cost nothing.
void run_shard(const Harmonics& table, const SharedBasis& mixed, const float* by_constant, std::size_t shard,
               std::size_t shards, float* by_weights, float* sums) {
  SharedGradient<3> shared(mixed.count, harmonics_of(table.degree), sums);
  Block block;
  alignas(64) Lanes weights[SH_MAX_BASIS];
  for_blocks_of(shard, shards, table.count, [&](std::size_t first) __attribute__((always_inline)) {
    Lanes by_sum[3];
    block.first = first;
    block.rows = table.count - first < LANES ? static_cast<int>(table.count - first) : LANES;
    const unsigned lit = find_gradient(by_constant, block, by_sum);
    if (!lit) {
      std::memset(by_weights + mixed.count * first, 0, sizeof(float) * mixed.count * block.rows);
      return;
    }
    open_block(table, first, table.count, block);
    load_weights(mixed, block, weights);
    const Mask lanes = mask_from_bits(lit);
    weights_gradient(mixed, block, lanes, by_sum, by_weights);
    shared.add(lanes, weights, block.basis, by_sum);
  });
  shared.flush();
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
