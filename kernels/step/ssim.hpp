// Photometric loss of Gaussian splatting: pixel term + structural similarity (Wang et al. 2004), value and gradient.
//
// Images are planar, [channels, height, width]. The window is an 11 x 11 Gaussian of sigma 1.5, zeros beyond the
// border, dynamic range 1, constants 0.01^2 and 0.03^2, as 3DGS has it.
#pragma once
#include <cstddef>

#include "simd/dispatch.hpp"

namespace ringlight {

struct Planes {
  int channels, height, width;
};

struct PhotometricWeights {
  float pixel, similarity;  // loss = pixel * mean(|d| or d^2) + similarity * (1 - mean SSIM)
  bool squared;             // pixel term d^2 instead of |d|
};

// The target's own blurs do not change while training: blur(y) and blur(y * y), from blur_target().
struct PhotometricImages {
  const float *image, *target, *target_blur, *target_square_blur;
  float* gradient;  // of the loss with respect to image; may not overlap the inputs
};

// How an image is cut into strips of rows, and what a strip keeps at hand.
namespace ssim {

constexpr int REACH = 5;                 // the window covers 11 = 2 * REACH + 1 pixels
constexpr int GROUP = 4;                 // rows blurred together: 14 rows are loaded for 4 results, not 44
constexpr int SPAN = GROUP + 2 * REACH;  // rows that one group reads
constexpr int RING = 16;                 // rows of SSIM derivatives kept: a power of two, SPAN in whole groups
constexpr int QUANTITIES = 3;            // forward blur(x), blur(x x), blur(x y); backward their three derivatives
constexpr int STRIP_ROWS = 100;          // at most; 10 rows of each neighbour are computed twice
constexpr int MARGIN = 16;               // zeros on each side of a row; one cache line, at least REACH
constexpr int ZEROED_ROWS = 4 + QUANTITIES * GROUP;  // zeros, three rows of sums, vertical blurs
constexpr int SCRATCH_ROWS = ZEROED_ROWS + QUANTITIES * (RING + 1);

// Internal linkage: each instruction set keeps its own copy.
static inline int strips_per_plane(int height) { return (height + STRIP_ROWS - 1) / STRIP_ROWS; }
static inline std::size_t row_floats(int width) {
  return (static_cast<std::size_t>(width) + MARGIN - 1) / MARGIN * MARGIN + 2 * MARGIN;
}
static inline std::size_t plane_floats(const Planes& planes) {
  return static_cast<std::size_t>(planes.height) * planes.width;
}

}  // namespace ssim

struct StripSums {
  double pixel, similarity;  // sums over the pixels and channels of one strip
};

// Work is cut into strips of rows, whose number depends on the image's size alone: sums never depend on threads.
std::size_t strips(const Planes& planes);

// Floats of workspace that one thread needs.
std::size_t strip_scratch(const Planes& planes);

// Value of the loss; fills the gradient. `workspace` holds workspace_size floats, at least strip_scratch(): as many
// threads run as it has room for. Throws std::invalid_argument when it is smaller.
double photometric(const PhotometricImages& images, const Planes& planes, const PhotometricWeights& weights,
                   float* workspace, std::size_t workspace_size);

// blur(image) and blur(image * image).
void blur_target(const float* image, const Planes& planes, float* blur, float* square_blur, float* workspace,
                 std::size_t workspace_size);

#define RINGLIGHT_DECLARE_SSIM(isa)                                                                               \
  namespace isa {                                                                                                 \
  StripSums photometric_strip(const PhotometricImages& images, const Planes& planes,                              \
                              const PhotometricWeights& weights, std::size_t strip, float* scratch);              \
  void blur_strip(const float* image, const Planes& planes, std::size_t strip, float* blur, float* square_blur,   \
                  float* scratch);                                                                                \
  }
RINGLIGHT_EVERY_ISA(RINGLIGHT_DECLARE_SSIM)
#undef RINGLIGHT_DECLARE_SSIM

}  // namespace ringlight
