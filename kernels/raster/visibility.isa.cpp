#include "raster/visibility.hpp"

#include <cstring>

#include "machine/parallel.hpp"
#include "machine/scratch.isa.hpp"
#include "simd/simd.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

constexpr std::size_t GRAIN = 8192;  // rows a piece: some ten microseconds

struct Centers {
  Vec x, y, z;
};

Centers to_camera(const float* matrix, Vec x, Vec y, Vec z) {
  const auto row = [&](const float* m) {
    return fma(Vec(m[0]), x, fma(Vec(m[1]), y, fma(Vec(m[2]), z, Vec(m[3]))));
  };
  return {row(matrix), row(matrix + 4), row(matrix + 8)};
}

// Sixteen rows; the largest scale times the Frobenius norm of the projection's Jacobian bounds the footprint.
Mask may_be_seen(const float* means, const float* log_scales, const Camera& camera, const DrawableMargins& margins) {
  Vec x, y, z, first, second, third;
  load_columns(means, x, y, z);
  load_columns(log_scales, first, second, third);
  const Centers at = to_camera(camera.world_to_camera, x, y, z);
  const Vec inverse = Vec(1.f) / at.z;
  Vec squared(0.f);
  Vec off[2];
  const Vec slopes[2] = {at.x * inverse, at.y * inverse};
  for (int axis = 0; axis < 2; axis++) {
    const float focal = axis ? camera.focal_y : camera.focal_x, center = axis ? camera.center_y : camera.center_x;
    const float size = static_cast<float>(axis ? camera.height : camera.width), half = 0.5f * size;
    const float farther = center > size - center ? center : size - center;
    const Vec steepest(margins.slope_margin * farther / focal);
    const Vec slope = min(steepest, max(-steepest, slopes[axis]));
    squared += Vec(focal * focal) * fma(slope, slope, Vec(1.f));
    off[axis] = abs(fma(Vec(focal), slopes[axis], Vec(center - half))) - Vec(half);
  }
  const Vec largest = exp(max(first, max(second, third)));
  const Vec reach = fma(Vec(margins.reach_sigmas) * largest * inverse, sqrt(squared), Vec(margins.reach_pixels));
  return both(gt(at.z, Vec(0.f)), both(ge(reach, off[0]), ge(reach, off[1])));
}

// Rows [begin, end) of the table, appended to `rows`.
std::size_t list_rows(const SplatColumns& table, std::size_t begin, std::size_t end, const Camera& camera,
                      const DrawableMargins& margins, std::int32_t* rows) {
  std::size_t found = 0;
  for (std::size_t row = begin; row < end; row += LANES) {
    alignas(64) float last_means[3 * LANES] = {}, last_scales[3 * LANES] = {};
    const float *mean = table.means + 3 * row, *scale = table.log_scales + 3 * row;
    const std::size_t left = end - row < LANES ? end - row : LANES;
    if (left < LANES) {
      std::memcpy(last_means, mean, 3 * left * sizeof(float));
      std::memcpy(last_scales, scale, 3 * left * sizeof(float));
      mean = last_means, scale = last_scales;
    }
    const Vec logits = load_first(table.opacity_logits + row, static_cast<int>(left));
    const Mask strong = ge(logits, Vec(margins.faintest_logit));
    unsigned seen = bits(both(strong, may_be_seen(mean, scale, camera, margins))) & ((1u << left) - 1);
    for (; seen; seen &= seen - 1) rows[found++] = static_cast<std::int32_t>(row) + __builtin_ctz(seen);
  }
  return found;
}

}  // namespace

std::size_t drawable_rows(const SplatColumns& table, const Camera& camera, const DrawableMargins& margins,
                          std::int32_t* rows) {
  const std::size_t count = table.count;
  const std::size_t pieces = (count + GRAIN - 1) / GRAIN;
  const Scratch memory(pieces * sizeof(std::size_t));
  auto* const found = static_cast<std::size_t*>(memory.data());
  parallel_ranges(count, GRAIN, [&](std::size_t begin, std::size_t end) {
    found[begin / GRAIN] = list_rows(table, begin, end, camera, margins, rows + begin);
  });
  std::size_t total = 0;
  for (std::size_t piece = 0; piece < pieces; piece++) {
    std::memmove(rows + total, rows + piece * GRAIN, found[piece] * sizeof(std::int32_t));
    total += found[piece];
  }
  return total;
}

void straight_through(const float* logits, std::size_t count, float threshold, float* factor) {
  parallel_ranges(count, GRAIN, [=](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; i += LANES) {
      const int left = end - i < LANES ? static_cast<int>(end - i) : LANES;
      const Vec soft = sigmoid(load_first(logits + i, left));
      store_first(factor + i, keep(gt(soft, Vec(threshold)), Vec(1.f)), left);
    }
  });
}

void straight_through_gradient(const float* logits, const float* upstream, std::size_t count, float* gradient) {
  parallel_ranges(count, GRAIN, [=](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; i += LANES) {
      const int left = end - i < LANES ? static_cast<int>(end - i) : LANES;
      const Vec soft = sigmoid(load_first(logits + i, left));
      store_first(gradient + i, load_first(upstream + i, left) * soft * (Vec(1.f) - soft), left);
    }
  });
}

}  // namespace ringlight::RINGLIGHT_ISA
