// Importance sampling: a backward pass computes a share of its items. An item's chance is in proportion to its upstream
// gradient, up to certainty; a drawn item counts 1 / chance, so that the expectation is the whole gradient. Chances are
// laid end to end and one item is drawn at every unit from a random start (systematic sampling): neighbours give the
// right number of items wherever they lie. The start is made of the bits of the gradients' sum, which are new every
// step: nothing is handed in or kept, and any number of threads gives the same bits. Reference:
// src/ringlight/core/importance_sampling.py.
#pragma once
#include <cstddef>
#include <cstdint>
#include <cstring>

namespace ringlight::RINGLIGHT_ISA {

// dL/dcolor of `item` is at values[item * item_stride + c * channel_stride], c from 0 to 2. `colors`, if any, lie in
// the same way: where one is not between 0 and 1 it was clamped, and hands nothing on.
struct ColorGradient {
  const float* values;
  std::size_t item_stride, channel_stride;
  const float* colors;

  // By masks: a processor cannot guess which colours were clamped.
  float operator()(std::int32_t item, int c) const {
    const std::size_t at = item * item_stride + c * channel_stride;
    if (!colors) return values[at];
    const bool passes = (colors[at] > 0.f) & (colors[at] < 1.f);
    std::uint32_t bits;
    std::memcpy(&bits, values + at, sizeof bits);
    bits &= -static_cast<std::uint32_t>(passes);
    float value;
    std::memcpy(&value, &bits, sizeof value);
    return value;
  }
  float size(std::int32_t item) const {
    return __builtin_fabsf((*this)(item, 0)) + __builtin_fabsf((*this)(item, 1)) + __builtin_fabsf((*this)(item, 2));
  }
};

// Chances are counted in units of this, so that their sum is exact.
constexpr std::uint64_t CERTAINTY = std::uint64_t{1} << 32;

// In [0, CERTAINTY). The steps between are Chris Wellons' lowbias32, a public-domain mixing of 32 bits.
static inline std::uint64_t random_start(float seed) {
  std::uint32_t mixed;
  std::memcpy(&mixed, &seed, sizeof mixed);
  mixed ^= mixed >> 16;
  mixed *= 0x7FEB352Du;
  mixed ^= mixed >> 15;
  mixed *= 0x846CA68Bu;
  return mixed ^ mixed >> 16;
}

// Keeps the drawn ones of `items`, in order, and in `weights`, which holds the sizes of their gradients, what each
// counts; returns how many. None of the sizes is 0. At most `share` of the items are expected; all are kept if share is
// 1, or a gradient is no number.
static inline std::size_t sample_measured(double share, std::size_t count, std::int32_t* items, float* weights) {
  double total = 0;
  for (std::size_t i = 0; i < count; i++) total += static_cast<double>(weights[i]);
  const float certain = static_cast<float>(total / (share * static_cast<double>(count)));
  if (share >= 1 || !(certain <= __FLT_MAX__)) {
    for (std::size_t i = 0; i < count; i++) weights[i] = 1.f;
    return count;
  }
  std::size_t drawn = 0;
  std::uint64_t sum = random_start(certain);
  for (std::size_t i = 0; i < count; i++) {
    const float size = weights[i];
    const std::uint64_t before = sum;
    sum += size < certain ? static_cast<std::uint64_t>(size / certain * static_cast<float>(CERTAINTY)) : CERTAINTY;
    items[drawn] = items[i];
    weights[drawn] = size < certain ? certain / size : 1.f;
    drawn += sum / CERTAINTY != before / CERTAINTY;
  }
  return drawn;
}

// The same for items whose gradients are not measured yet; those that have none are never kept.
static inline std::size_t sample_by_gradient(const ColorGradient& gradient, double share, std::size_t count,
                                             std::int32_t* items, float* weights) {
  std::size_t with_gradient = 0;
  for (std::size_t i = 0; i < count; i++) {
    const float size = gradient.size(items[i]);
    items[with_gradient] = items[i];
    weights[with_gradient] = size;
    with_gradient += size != 0.f;
  }
  return sample_measured(share, with_gradient, items, weights);
}

}  // namespace ringlight::RINGLIGHT_ISA
