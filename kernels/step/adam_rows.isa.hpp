// One parameter's Adam update, as all kernels that make one share it.
#pragma once
#include "step/adam.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

// What all elements of a parameter share.
struct AdamFactors {
  float rate, correction, keep1, keep2, epsilon;

  explicit AdamFactors(const AdamStep& step) : keep1(step.beta1), keep2(step.beta2), epsilon(step.epsilon) {
    const double number = static_cast<double>(step.step);
    rate = step.rate / static_cast<float>(1 - __builtin_pow(step.beta1, number));
    correction = static_cast<float>(1 / __builtin_sqrt(1 - __builtin_pow(step.beta2, number)));
  }
};

// Returns how many elements were left as they were, because any of theirs would not be finite afterwards. Never
// inlined: the gradient is rounded before it gets here, whoever makes it, so that all callers give the same bits.
[[gnu::noinline]] std::size_t adam_update(const AdamRows& rows, const float* gradient, const AdamFactors& factors,
                                          std::size_t count) {
  const auto [rate, correction, keep1, keep2, epsilon] = factors;
  float *value = rows.value, *mean = rows.mean, *square = rows.square;
  int kept = 0;
#pragma GCC ivdep
  for (std::size_t i = 0; i < count; i++) {
    const float g = gradient[i];
    const float m = mean[i] + (1 - keep1) * (g - mean[i]);
    const float v = keep2 * square[i] + (1 - keep2) * g * g;
    const float x = value[i] - rate * m / (__builtin_sqrtf(v) * correction + epsilon);
    const bool is_finite = (m - m) + (v - v) + (x - x) == 0;
    mean[i] = is_finite ? m : mean[i];
    square[i] = is_finite ? v : square[i];
    value[i] = is_finite ? x : value[i];
    kept += is_finite ? 0 : 1;
  }
  return static_cast<std::size_t>(kept);
}

}  // namespace
}  // namespace ringlight::RINGLIGHT_ISA
