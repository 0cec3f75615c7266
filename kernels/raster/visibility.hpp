// Which Gaussians are worth a colour: those that a rasterizer could draw from here, and those that the mask keeps.
#pragma once
#include <cstddef>
#include <cstdint>

#include "simd/dispatch.hpp"

namespace ringlight {

// A pinhole view and the margins of color/drawable.py, which explains them.
struct DrawableView {
  float world_to_camera[12];           // the upper three rows
  float focal[2], center[2], size[2];  // pixels
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
  std::size_t drawable_rows(const SplatColumns& table, const DrawableView& view, std::int32_t* rows); \
  void straight_through(const float* logits, std::size_t count, float threshold, float* factor); \
  void straight_through_gradient(const float* logits, const float* upstream, std::size_t count, float* gradient); \
  }
RINGLIGHT_EVERY_ISA(RINGLIGHT_VISIBILITY)
#undef RINGLIGHT_VISIBILITY

}  // namespace ringlight
