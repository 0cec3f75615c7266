// The gradient of what all Gaussians share, summed over the blocks of one shard.
#pragma once
#include <cstring>

#include "step/sh_block.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

// sums[j][k][c][lane] += weights[j] harmonics[k] given[c], for several blocks at once: loading and storing the sums
// takes longer than adding to them. `Channels` are colours, or one.
template <int Channels>
class SharedGradient {
 public:
  // `sums` [weights, HARMONICS, Channels, LANES] are set to zero.
  SharedGradient(int weights, int harmonics, float* sums) : weights_(weights), harmonics_(harmonics), sums_(sums) {
    std::memset(sums, 0, sizeof(Lanes) * HARMONICS * Channels * static_cast<std::size_t>(weights));
  }

  // Only the lanes that are `lit`: others must not reach the sums, which all share, even if they are not numbers.
  void add(Mask lit, const Lanes* weights, const Lanes* harmonics, const Lanes* given) {
    Held& to = held_[count_++];
    for (int j = 0; j < weights_; j++) store(to.weights[j], keep(lit, load(weights[j])));
    for (int k = 0; k < harmonics_; k++) store(to.harmonics[k], keep(lit, load(harmonics[k])));
    for (int c = 0; c < Channels; c++) store(to.given[c], keep(lit, load(given[c])));
    if (count_ == TOGETHER) flush();
  }

  // To be called after the last block.
  void flush() {
    for (; count_ < TOGETHER; count_++) std::memset(&held_[count_], 0, sizeof(Held));
    count_ = 0;
    for (int j = 0; j < weights_; j++)
      for (int c = 0; c < Channels; c++) {
        Vec factors[TOGETHER];
#pragma GCC unroll 4
        for (int i = 0; i < TOGETHER; i++) factors[i] = load(held_[i].weights[j]) * load(held_[i].given[c]);
        float* to = sums_ + (HARMONICS * Channels * j + c) * LANES;
        for (int k = 0; k < harmonics_; k++, to += Channels * LANES) {
          Vec sum = load(to);
#pragma GCC unroll 4
          for (int i = 0; i < TOGETHER; i++) sum = fma(load(held_[i].harmonics[k]), factors[i], sum);
          store(to, sum);
        }
      }
  }

 private:
  static constexpr int TOGETHER = 4;  // blocks, so that their factors stay in registers
  struct Held {
    Lanes weights[SH_MAX_BASIS], harmonics[HARMONICS], given[Channels];
  };

  alignas(64) Held held_[TOGETHER];
  int count_ = 0, weights_, harmonics_;
  float* sums_;
};

}  // namespace
}  // namespace ringlight::RINGLIGHT_ISA
