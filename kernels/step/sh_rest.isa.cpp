// The coefficients' gradient is an outer product, harmonics by colours. Written down it is most of what a step would
// move through memory, so that Adam makes it block by block where it is used.
#include "machine/parallel.hpp"
#include "step/adam_rows.isa.hpp"
#include "step/sh.hpp"
#include "step/sh_block.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

constexpr std::size_t GRAIN = 16 * LANES;  // rows a piece: value and moments, 140 KB of degree 3, stay in L2

// rows[lane][k] = planar[k][lane], `stored` of them a row.
void to_rows(const Lanes* planar, int stored, float* rows) {
  for (int first = 0; first < stored; first += LANES) {
    const int start = piece_start(first, stored);
    Vec square[LANES];
    for (int k = 0; k < LANES; k++) square[k] = load(planar[start + k]);
    transpose(square);
    for (int lane = 0; lane < LANES; lane++) {
      float* const to = rows + stored * lane + start;
      if (stored < LANES) store_first(to, square[lane], stored);
      else store(to, square[lane]);
    }
  }
}

// [LANES][stored] of one block; zero for harmonics above the degree.
void find_gradient(const float* by_constant, const Block& block, int stored, float* rows) {
  Lanes by_sum[3], planar[SH_REST];
  load_triples(by_constant, block, by_sum);
  for (int c = 0; c < 3; c++)
    for (int i = 0; i < LANES; i++) by_sum[c][i] *= 1 / C0;
  for (int k = 0; k < block.count; k++)
    for (int c = 0; c < 3; c++)
      for (int i = 0; i < LANES; i++) planar[3 * k + c][i] = block.basis[k][i] * by_sum[c][i];
  for (int k = 3 * block.count; k < (stored < LANES ? LANES : stored); k++)
    for (int i = 0; i < LANES; i++) planar[k][i] = 0;
  to_rows(planar, stored, rows);
}

// Moments and gradients of harmonics that were never in use are zero, and Adam leaves them as they are: whole vectors
// of them are skipped. Returns how many elements Adam left because they would not be finite.
std::size_t update_block(const Block& block, std::size_t row, const AdamFactors& factors, const float* gradient,
                         const AdamRows& rows) {
  const std::size_t used = static_cast<std::size_t>(3 * block.count);
  const std::size_t width = (used + LANES - 1) / LANES * LANES, count = static_cast<std::size_t>(block.rows);
  const AdamRows first = rows.from(block.first * row);
  if (width >= row) return adam_update(first, gradient, factors, count * row);
  std::size_t kept = 0;
  for (std::size_t i = 0; i < count * row; i += row) kept += adam_update(first.from(i), gradient + i, factors, width);
  return kept;
}

}  // namespace

void sh_rest_gradient(const Harmonics& table, const float* by_constant, float* by_rest) {
  const std::size_t row = static_cast<std::size_t>(table.stored);
  parallel_ranges(table.count, GRAIN, [&](std::size_t begin, std::size_t end) {
    Block block;
    float gradient[LANES * SH_REST];
    for (std::size_t first = begin; first < end; first += LANES) {
      open_block(table, first, end, block);
      find_gradient(by_constant, block, table.stored, gradient);
      const std::size_t floats = static_cast<std::size_t>(block.rows) * row;
      for (std::size_t i = 0; i < floats; i++) by_rest[first * row + i] = gradient[i];
    }
  });
}

std::size_t sh_rest_adam(const Harmonics& table, const float* by_constant, const AdamRows& rows,
                         const AdamStep& step) {
  if (table.degree == 0) return 0;
  const AdamFactors factors(step);
  std::size_t all_kept = 0;
  std::size_t* const sum = &all_kept;
  parallel_ranges(table.count, GRAIN, [&, sum](std::size_t begin, std::size_t end) {
    Block block;
    alignas(64) float gradient[LANES * SH_REST];
    std::size_t kept = 0;
    for (std::size_t first = begin; first < end; first += LANES) {
      open_block(table, first, end, block);
      find_gradient(by_constant, block, table.stored, gradient);
      kept += update_block(block, static_cast<std::size_t>(table.stored), factors, gradient, rows);
    }
    if (kept) __atomic_fetch_add(sum, kept, __ATOMIC_RELAXED);
  });
  return all_kept;
}

}  // namespace ringlight::RINGLIGHT_ISA
