// The samples of a ray in its box that are not known to be empty.
#pragma once
#include "simd/simd.isa.hpp"
#include "volume/volume.hpp"

namespace ringlight::RINGLIGHT_ISA {

using convention::VOLUME_SMALLEST_STEP;

// One ray in units of the box and of the cells: place = start + along * slope.
struct Walk {
  float near, jitter;
  int count;
  float place_start[3], place_slope[3], cell_start[3], cell_slope[3];

  Walk(const VolumeRays& rays, const VolumeSpace& space, std::size_t ray) : near(0.f), jitter(rays.jitter[ray]) {
    float far = __builtin_huge_valf();
    for (int axis = 0; axis < 3; axis++) {
      const float origin = rays.origins[3 * ray + axis], direction = rays.directions[3 * ray + axis];
      const float small = direction < 0.f ? -VOLUME_SMALLEST_STEP : VOLUME_SMALLEST_STEP;
      const float slope = 1.f / (__builtin_fabsf(direction) < VOLUME_SMALLEST_STEP ? small : direction);
      const float one = (space.low[axis] - origin) * slope, other = (space.high[axis] - origin) * slope;
      near = __builtin_fmaxf(near, __builtin_fminf(one, other));
      far = __builtin_fminf(far, __builtin_fmaxf(one, other));
      const float side = 1.f / (space.high[axis] - space.low[axis]);
      place_start[axis] = (origin - space.low[axis]) * side, place_slope[axis] = direction * side;
      const float cell = static_cast<float>(space.cells[axis]) / (space.cells_high[axis] - space.cells_low[axis]);
      cell_start[axis] = (origin - space.cells_low[axis]) * cell, cell_slope[axis] = direction * cell;
    }
    const float steps = __builtin_ceilf((far - near) / space.step - jitter);
    count = steps > 0.f ? (steps < static_cast<float>(space.most) ? static_cast<int>(steps) : space.most) : 0;
  }

  Vec along(const VolumeSpace& space, int first) const {
    alignas(64) static const float numbers[LANES] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
    return fma(load(numbers) + Vec(static_cast<float>(first) + jitter), Vec(space.step), Vec(near));
  }

  // Bits of the samples from `first` on, up to sixteen, whose cells are not empty.
  unsigned occupied(const VolumeSpace& space, int first) const {
    const Vec t = along(space, first);
    alignas(64) int cells[3][LANES];
    for (int axis = 0; axis < 3; axis++) {
      const Vec last(static_cast<float>(space.cells[axis] - 1));
      const Vec at = max(Vec(0.f), min(fma(t, Vec(cell_slope[axis]), Vec(cell_start[axis])), last));
      store(cells[axis], truncate(at));
    }
    unsigned found = 0;
    const int left = count - first < LANES ? count - first : LANES;
    for (int i = 0; i < left; i++) {
      const std::size_t row = static_cast<std::size_t>(cells[0][i]) * space.cells[1] + cells[1][i];
      const unsigned byte = space.bits[row * (space.cells[2] / 8) + (cells[2][i] >> 3)];
      found |= (byte >> (cells[2][i] & 7) & 1u) << i;
    }
    return found;
  }
};

}  // namespace ringlight::RINGLIGHT_ISA
