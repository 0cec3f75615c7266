// Opacities from spherical harmonics of one channel. The way back computes them again: a row is a line of memory.
#include "step/sh_opacity.hpp"

#include "machine/parallel.hpp"
#include "simd/row_columns.isa.hpp"
#include "step/opacity_rows.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

constexpr std::size_t GRAIN = 64 * LANES;  // rows a piece: 64 KB of degree 3

// One block's rows, seen from the camera.
struct Opacities {
  Block block;
  Coefficients coefficients;
  Lanes mean, light;  // sigmoid(logit), and what it leaves of one: the difference would lose digits
  Lanes free, over;   // mean + rest basis, not clamped; what the factor is divided by
};

void open_opacities(const DirectionalOpacities& table, std::size_t first, std::size_t end, Opacities& found) {
  Block& block = found.block;
  open_block(table.harmonics, first, end, block);
  load_coefficients(table.harmonics, block, block.count, found.coefficients);
  const Vec logits = load_first(table.logits + first, block.rows);
  store(found.mean, sigmoid(logits));
  store(found.light, sigmoid(-logits));
  for (int i = 0; i < LANES; i++) found.free[i] = found.mean[i];
  for (int k = 0; k < block.count; k++)
    for (int i = 0; i < LANES; i++) found.free[i] += block.basis[k][i] * found.coefficients[k][i];
  for (int i = 0; i < LANES; i++) found.over[i] = found.mean[i] > table.least ? found.mean[i] : table.least;
}

// d(factor) to dL/d(opacity), and dL/d(logit), which is added: the factor falls as what it is divided by rises.
void by_opacities(const DirectionalOpacities& table, const float* upstream, const Opacities& of, Lanes by_opacity,
                  float* logits) {
  Lanes by_logit;
  for (int i = 0; i < LANES; i++) {
    const float free = of.free[i], over = of.over[i], mean = of.mean[i];
    const float shown = free < 0 ? 0 : free > 1 ? 1 : free;
    by_opacity[i] = free >= 0 && free <= 1 ? upstream[i] / over : 0.0f;
    const float divided = mean > table.least ? upstream[i] * shown / (over * over) : 0.0f;
    by_logit[i] = (by_opacity[i] - divided) * mean * of.light[i];
  }
  float* const to = logits + of.block.first;
  store_first(to, load_first(to, of.block.rows) + load(by_logit), of.block.rows);
}

// Zeros where nobody saw the block.
void write_rest(const Lanes by_opacity, const Block& block, int stored, float* rest) {
  Vec columns[LANES];
  const Vec upstream = load(by_opacity);
  for (int k = 0; k < LANES; k++) columns[k] = k < block.count ? load(block.basis[k]) * upstream : Vec(0.f);
  put_columns(rest + static_cast<std::size_t>(stored) * block.first, stored, block.rows, columns);
}

}  // namespace

void sh_opacity_factors(const DirectionalOpacities& table, float* factors) {
  parallel_ranges(table.harmonics.count, GRAIN, [&](std::size_t begin, std::size_t end) {
    alignas(64) Opacities found;
    for (std::size_t first = begin; first < end; first += LANES) {
      open_opacities(table, first, end, found);
      Lanes factor;
      for (int i = 0; i < LANES; i++) {
        const float free = found.free[i];
        factor[i] = (free < 0 ? 0 : free > 1 ? 1 : free) / found.over[i];  // NaN stays
      }
      store_first(factors + first, load(factor), found.block.rows);
    }
  });
}

void sh_opacity_gradient(const DirectionalOpacities& table, const float* by_factors,
                         const DirectionalOpacityGradients& to) {
  const int stored = table.harmonics.stored;
  parallel_ranges(table.harmonics.count, GRAIN, [&](std::size_t begin, std::size_t end) {
    alignas(64) Opacities found;
    for (std::size_t first = begin; first < end; first += LANES) {
      const int rows = end - first < LANES ? static_cast<int>(end - first) : LANES;
      Lanes upstream, by_opacity;
      store(upstream, load_first(by_factors + first, rows));
      if (is_zero(upstream)) {
        float* const rest = to.rest + static_cast<std::size_t>(stored) * first;
        for (int i = 0; i < rows * stored; i++) rest[i] = 0;
        continue;
      }
      open_opacities(table, first, end, found);
      by_opacities(table, upstream, found, by_opacity, to.logits);
      add_to_means(by_opacity, table.harmonics.degree, found.block, found.coefficients, to.means);
      write_rest(by_opacity, found.block, stored, to.rest);
    }
  });
}

}  // namespace ringlight::RINGLIGHT_ISA
