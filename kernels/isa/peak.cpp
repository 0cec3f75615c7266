#include "peak.hpp"

#include "parallel.hpp"
#include "simd.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

// More than the multiply-adds in flight (latency times units, at most ten registers), and they stay in registers.
constexpr int CHAINS = VEC_REGISTERS * 3 / 4;

// Never inlined: the compiler must not see that nobody looks at most of the sums.
[[gnu::noinline]] float chains(std::size_t rounds, float factor, float summand) {
  Vec values[CHAINS];
#pragma GCC unroll 32
  for (int i = 0; i < CHAINS; i++) values[i] = Vec(static_cast<float>(i));
  const Vec a(factor), b(summand);
  for (std::size_t round = 0; round < rounds; round++)
#pragma GCC unroll 32
    for (int i = 0; i < CHAINS; i++) values[i] = fma(values[i], a, b);
#pragma GCC unroll 32
  for (int i = 1; i < CHAINS; i++) values[0] += values[i];
  float lanes[LANES];
  store(lanes, values[0]);
  return lanes[0];
}

}  // namespace

double multiply_adds(std::size_t pieces, std::size_t rounds) {
  parallel_for(pieces, [=](std::size_t) {
    [[maybe_unused]] volatile float used = chains(rounds, 0.5f, 1.f);  // tends to 2: no overflow, no subnormals
  });
  return 2.0 * CHAINS * LANES * static_cast<double>(rounds) * static_cast<double>(pieces);
}

}  // namespace ringlight::RINGLIGHT_ISA
