// Which Gaussians are worth a colour: those that a rasterizer could draw from here, and those that the mask keeps.
#pragma once
#include <cstddef>
#include <cstdint>

namespace ringlight {

// A pinhole view and the margins of color/frustum.py, which explains them.
struct FrustumView {
  float world_to_camera[12];           // the upper three rows
  float focal[2], center[2], size[2];  // pixels
  float reach_sigmas, reach_pixels, slope_margin;
};

namespace v3 {
// Writes the numbers of the rows that may be seen, ascending, and returns how many; `rows` has room for `count`.
std::size_t rows_in_frustum(const float* means, const float* log_scales, std::size_t count, const FrustumView& view,
                            std::int32_t* rows);
// factor = 1 where sigmoid(logit) > threshold, else 0; the gradient is the sigmoid's (RingLight-GS, eq. 10).
void straight_through(const float* logits, std::size_t count, float threshold, float* factor);
void straight_through_gradient(const float* logits, const float* upstream, std::size_t count, float* gradient);
}  // namespace v3
namespace v4 {
std::size_t rows_in_frustum(const float* means, const float* log_scales, std::size_t count, const FrustumView& view,
                            std::int32_t* rows);
void straight_through(const float* logits, std::size_t count, float threshold, float* factor);
void straight_through_gradient(const float* logits, const float* upstream, std::size_t count, float* gradient);
}  // namespace v4

}  // namespace ringlight
