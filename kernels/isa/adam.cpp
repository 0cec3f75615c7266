#include "adam.hpp"

#include "parallel.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {
constexpr std::size_t GRAIN = 16384;  // floats a piece: four arrays of 64 KB stay in L2
}

void adam(float* value, const float* gradient, float* mean, float* square, std::size_t count, const AdamStep& step) {
  const float rate = step.rate / static_cast<float>(1 - __builtin_pow(step.beta1, static_cast<double>(step.step)));
  const float correction = static_cast<float>(1 / __builtin_sqrt(1 - __builtin_pow(step.beta2, static_cast<double>(step.step))));
  const float keep1 = step.beta1, keep2 = step.beta2, epsilon = step.epsilon;
  parallel_ranges(count, GRAIN, [=](std::size_t begin, std::size_t end) {
#pragma GCC ivdep
    for (std::size_t i = begin; i < end; i++) {
      const float g = gradient[i];
      const float m = mean[i] + (1 - keep1) * (g - mean[i]);
      const float v = keep2 * square[i] + (1 - keep2) * g * g;
      mean[i] = m;
      square[i] = v;
      value[i] -= rate * m / (__builtin_sqrtf(v) * correction + epsilon);
    }
  });
}

}  // namespace ringlight::RINGLIGHT_ISA
