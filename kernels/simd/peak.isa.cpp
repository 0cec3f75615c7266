#include "simd/peak.hpp"

#include "machine/parallel.hpp"
#include "simd/simd.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

// More than the multiply-adds in flight (latency times units, at most ten registers), and they stay in registers.
constexpr int CHAINS = VEC_REGISTERS * 3 / 4;
constexpr int NUMBERS = CHAINS * LANES;

// Never inlined, and every lane begins with a number of its own and is looked at in the end: what the compiler knows to
// be equal, or to be of no use, it computes once or not at all.
[[gnu::noinline]] void chains(std::size_t rounds, float factor, float summand, float* numbers) {
  Vec values[CHAINS];
#pragma GCC unroll 32
  for (int i = 0; i < CHAINS; i++) values[i] = load(numbers + i * LANES);
  const Vec a(factor), b(summand);
  for (std::size_t round = 0; round < rounds; round++)
#pragma GCC unroll 32
    for (int i = 0; i < CHAINS; i++) values[i] = fma(values[i], a, b);
#pragma GCC unroll 32
  for (int i = 0; i < CHAINS; i++) store(numbers + i * LANES, values[i]);
}

}  // namespace

double multiply_adds(std::size_t pieces, std::size_t rounds, float* sums) {
  parallel_for(pieces, [=](std::size_t piece) {
    float numbers[NUMBERS];
    for (int i = 0; i < NUMBERS; i++) numbers[i] = static_cast<float>(i);
    chains(rounds, 0.5f, 1.f, numbers);  // tends to 2: no overflow, no subnormals
    float sum = 0;
    for (int i = 0; i < NUMBERS; i++) sum += numbers[i];
    sums[piece] = sum;
  });
  return 2.0 * NUMBERS * static_cast<double>(rounds) * static_cast<double>(pieces);
}

}  // namespace ringlight::RINGLIGHT_ISA
