// Which Gaussians are worth a colour: those that a rasterizer could draw from here, and those that the mask keeps.
#pragma once
#include <cstddef>
#include <cstdint>

#include "raster/camera.hpp"
#include "simd/dispatch.hpp"

namespace ringlight {

// color/drawable.py explains them.
struct DrawableMargins {
  float reach_sigmas, reach_pixels, slope_margin, faintest_logit;
};

struct SplatColumns {
  const float *means, *log_scales, *opacity_logits;  // [count 3], [count 3], [count]
  std::size_t count;
};

// Writes the numbers of the rows that may be drawn, ascending, and returns how many; `rows` has room for `count`.
// factor = 1 where sigmoid(logit) > threshold, else 0; the gradient is the sigmoid's (RingLight-GS, eq. 10).
#define RINGLIGHT_VISIBILITY(isa) \
  namespace isa { \
  std::size_t drawable_rows(const SplatColumns& table, const Camera& camera, const DrawableMargins& margins, \
                            std::int32_t* rows); \
  void straight_through(const float* logits, std::size_t count, float threshold, float* factor); \
  void straight_through_gradient(const float* logits, const float* upstream, std::size_t count, float* gradient); \
  }
RINGLIGHT_EVERY_ISA(RINGLIGHT_VISIBILITY)
#undef RINGLIGHT_VISIBILITY

}  // namespace ringlight
