#include "step/screen_gradient.hpp"

#include "machine/parallel.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {
constexpr std::size_t GRAIN = 1 << 18;  // rows a piece: fewer are done before another thread is awake
}

void accumulate_screen_gradient(const float* gradient, const float* radii, ScreenScale scale, float* total,
                                float* views, std::size_t count) {
  parallel_ranges(count, GRAIN, [=](std::size_t begin, std::size_t end) {
#pragma GCC ivdep
    for (std::size_t i = begin; i < end; i++) {
      const float x = gradient[2 * i] * scale.x, y = gradient[2 * i + 1] * scale.y;
      const bool drawn = radii[2 * i] > 0;
      const float length = __builtin_sqrtf(x * x + y * y);
      total[i] += drawn && length <= __FLT_MAX__ ? length : 0.f;  // what is not finite would stay for good
      views[i] += drawn ? 1.f : 0.f;
    }
  });
}

}  // namespace ringlight::RINGLIGHT_ISA
