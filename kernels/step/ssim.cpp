#include "step/ssim.hpp"

#include <algorithm>
#include <atomic>
#include <stdexcept>
#include <vector>

#include "machine/parallel.hpp"
#include "simd/dispatch.hpp"

namespace ringlight {
namespace {

// Calls body(strip, scratch) for every strip; each thread that takes part owns one slice of the workspace.
template <class F>
void for_each_strip(const Planes& planes, float* workspace, std::size_t workspace_size, F&& body) {
  const std::size_t pieces = strips(planes), slice = strip_scratch(planes);
  const std::size_t slots = std::min({workspace_size / slice, static_cast<std::size_t>(threads()), pieces});
  if (slots == 0) throw std::invalid_argument("photometric: the workspace is smaller than one strip needs");
  std::atomic<std::size_t> next{0};
  parallel_for(slots, [&](std::size_t slot) {
    for (std::size_t strip; (strip = next.fetch_add(1, std::memory_order_relaxed)) < pieces;)
      body(strip, workspace + slot * slice);
  });
}

}  // namespace

std::size_t strips(const Planes& planes) {
  return static_cast<std::size_t>(planes.channels) * ssim::strips_per_plane(planes.height);
}

std::size_t strip_scratch(const Planes& planes) { return ssim::SCRATCH_ROWS * ssim::row_floats(planes.width); }

double photometric(const PhotometricImages& images, const Planes& planes, const PhotometricWeights& weights,
                   float* workspace, std::size_t workspace_size) {
  const auto run = RINGLIGHT_CHOSEN(photometric_strip);
  std::vector<StripSums> sums(strips(planes));
  for_each_strip(planes, workspace, workspace_size, [&](std::size_t strip, float* scratch) {
    sums[strip] = run(images, planes, weights, strip, scratch);
  });
  StripSums total{0, 0};
  for (const StripSums& sum : sums) {
    total.pixel += sum.pixel;
    total.similarity += sum.similarity;
  }
  const double count = static_cast<double>(planes.channels * ssim::plane_floats(planes));
  return weights.pixel * (total.pixel / count) + weights.similarity * (1 - total.similarity / count);
}

void blur_target(const float* image, const Planes& planes, float* blur, float* square_blur, float* workspace,
                 std::size_t workspace_size) {
  const auto run = RINGLIGHT_CHOSEN(blur_strip);
  for_each_strip(planes, workspace, workspace_size, [&](std::size_t strip, float* scratch) {
    run(image, planes, strip, blur, square_blur, scratch);
  });
}

}  // namespace ringlight
