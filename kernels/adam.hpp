// Adam on one flat parameter. Kingma & Ba 2015, algorithm 1, with epsilon outside the bias correction as torch has it.
#pragma once
#include <cstddef>

namespace ringlight {

struct AdamStep {
  float rate, beta1, beta2, epsilon;
  long step;  // 1 for the first update
};

namespace v3 {
void adam(float* value, const float* gradient, float* mean, float* square, std::size_t count, const AdamStep& step);
}
namespace v4 {
void adam(float* value, const float* gradient, float* mean, float* square, std::size_t count, const AdamStep& step);
}

}  // namespace ringlight
