#include "machine/parallel.hpp"
#include "volume/factors.isa.hpp"
#include "volume/walk.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

constexpr std::size_t RAYS = 32, PLACES = 4096;  // a piece

// Softplus and its slope. Beyond this softplus is its argument to the last bit.
constexpr float LINEAR_FROM = 20.f;

struct Softplus {
  Vec value, slope;
};

Softplus softplus(Vec x) {
  const Vec power = exp(x), wide = Vec(1.f) + power;
  // log(1 + p): for small p the sum rounds p away, so that its series is taken.
  const Vec small = power * fnma(power, fnma(power, Vec(1.f / 3), Vec(0.5f)), Vec(1.f));
  const Vec log = select(lt(power, Vec(4e-3f)), small, log2(wide) * Vec(0.693147181f));
  const Mask bent = lt(x, Vec(LINEAR_FROM));  // not of what is no number, which stays so
  return {select(bent, log, x), select(bent, power / wide, Vec(1.f))};
}

// 1 - e^-x for x >= 0; what is no number stays so.
Vec absorbed(Vec x) {
  const Vec series = x * fnma(x, fnma(x, fnma(x, Vec(1.f / 24), Vec(1.f / 6)), Vec(0.5f)), Vec(1.f));
  return select(lt(x, Vec(3e-2f)), series, select(gt(x, Vec(0.f)), Vec(1.f) - exp(Vec(0.f) - x), x));
}

// What a ray has come to.
struct Light {
  float thickness = 0.f, alpha = 0.f, depth = 0.f;
  int shown = 0;
};

// Up to sixteen samples in a row, with the numbers that softplus is taken of; returns how many of them come before the
// ray's end.
int see(Vec densities, const VolumeOptics& optics, const VolumeSamples& to, std::size_t at, int count, Light& light) {
  alignas(64) float opaque[LANES], thick[LANES];
  const Softplus density = softplus(densities + Vec(optics.shift));
  const Vec thickness = density.value * Vec(optics.optical);
  store(thick, thickness);
  store(opaque, absorbed(thickness));
  store_first(to.slopes + at, density.slope * Vec(optics.optical), count);
  // e^-thickness before and behind each sample.
  alignas(64) float before[LANES], behind[LANES];
  float total = light.thickness;
  for (int i = 0; i < count; i++) before[i] = total, total += thick[i], behind[i] = total;
  for (int i = count; i < LANES; i++) before[i] = behind[i] = total;
  store(before, exp(Vec(0.f) - load(before)));
  store(behind, exp(Vec(0.f) - load(behind)));
  for (int i = 0; i < count; i++) {
    if (!(before[i] >= optics.end)) return i;
    const float weight = before[i] * opaque[i];
    to.weights[at + i] = weight;
    to.left[at + i] = behind[i];
    light.alpha += weight;
    light.depth += weight * to.along[at + i];
    light.shown += weight > optics.shown;
  }
  light.thickness = total;
  return count;
}

// One ray, whose samples are those from `at` to `placed`; up to `last`, and behind its end, there is nothing.
// `densities_of(at, count)` of up to sixteen samples is asked for in their order.
template <class Densities>
Light seen_along(const Densities& densities_of, const VolumeOptics& optics, const VolumeSamples& to, std::size_t at,
                 std::size_t placed, std::size_t last) {
  Light light;
  while (at < placed) {
    const int count = placed - at < LANES ? static_cast<int>(placed - at) : LANES;
    const int seen = see(densities_of(at, count), optics, to, at, count, light);
    at += seen;
    if (seen < count) break;
  }
  for (; at < last; at++) to.weights[at] = to.left[at] = to.slopes[at] = 0.f;
  return light;
}

// Writes the samples of one ray that are not empty, up to `last`; returns where they end. There is nothing behind.
std::size_t place(const Walk& walk, const VolumeSpace& space, const VolumeSamples& to, std::size_t at,
                  std::size_t last) {
  for (int first = 0; first < walk.count && at < last; first += LANES) {
    const unsigned found = walk.occupied(space, first);
    if (!found) continue;
    alignas(64) float along[LANES];
    store(along, walk.along(space, first));
    for (unsigned left = found; left && at < last; left &= left - 1, at++) {
      const float t = along[__builtin_ctz(left)];
      to.along[at] = t;
      for (int axis = 0; axis < 3; axis++)
        to.places[3 * at + axis] = __builtin_fmaf(t, walk.place_slope[axis], walk.place_start[axis]);
    }
  }
  for (std::size_t spare = at; spare < last; spare++) {
    to.along[spare] = 0.f;
    for (int axis = 0; axis < 3; axis++) to.places[3 * spare + axis] = 0.f;
  }
  return at;
}

}  // namespace

void volume_count(const VolumeRays& rays, const VolumeSpace& space, std::int32_t* counts) {
  parallel_ranges(rays.count, RAYS, [=](std::size_t begin, std::size_t end) {
    for (std::size_t ray = begin; ray < end; ray++) {
      const Walk walk(rays, space, ray);
      int count = 0;
      for (int first = 0; first < walk.count; first += LANES)
        count += __builtin_popcount(walk.occupied(space, first));
      counts[ray] = count;
    }
  });
}

void volume_march(const VolumeRays& rays, const VolumeSpace& space, const VolumeFactors<const float>& factors,
                  const VolumeOptics& optics, const std::int64_t* offsets, const VolumeSamples& to,
                  std::int32_t* shown, float* alpha, float* depth) {
  const auto densities_of = [=](std::size_t at, int count) { return densities_at(factors, to.places + 3 * at, count); };
  parallel_ranges(rays.count, RAYS, [=](std::size_t begin, std::size_t end) {
    for (std::size_t ray = begin; ray < end; ray++) {
      const auto first = static_cast<std::size_t>(offsets[ray]), last = static_cast<std::size_t>(offsets[ray + 1]);
      const std::size_t placed = place(Walk(rays, space, ray), space, to, first, last);
      const Light light = seen_along(densities_of, optics, to, first, placed, last);
      shown[ray] = light.shown, alpha[ray] = light.alpha, depth[ray] = light.depth;
    }
  });
}

void volume_place(const VolumeRays& rays, const VolumeSpace& space, const std::int64_t* offsets,
                  const VolumeSamples& to) {
  parallel_ranges(rays.count, RAYS, [=](std::size_t begin, std::size_t end) {
    for (std::size_t ray = begin; ray < end; ray++)
      place(Walk(rays, space, ray), space, to, static_cast<std::size_t>(offsets[ray]),
            static_cast<std::size_t>(offsets[ray + 1]));
  });
}

void volume_weigh(std::size_t rays, const std::int64_t* offsets, const float* densities, const VolumeOptics& optics,
                  const VolumeSamples& to, std::int32_t* shown, float* alpha, float* depth) {
  const auto densities_of = [=](std::size_t at, int count) { return load_first(densities + at, count); };
  parallel_ranges(rays, RAYS, [=](std::size_t begin, std::size_t end) {
    for (std::size_t ray = begin; ray < end; ray++) {
      const auto first = static_cast<std::size_t>(offsets[ray]), last = static_cast<std::size_t>(offsets[ray + 1]);
      const Light light = seen_along(densities_of, optics, to, first, last, last);
      shown[ray] = light.shown, alpha[ray] = light.alpha, depth[ray] = light.depth;
    }
  });
}

void volume_density(const VolumeFactors<const float>& factors, const float* places, std::size_t count,
                    float* density) {
  parallel_ranges(count, PLACES, [=](std::size_t begin, std::size_t end) {
    for (std::size_t at = begin; at < end; at += LANES) {
      const int here = end - at < LANES ? static_cast<int>(end - at) : LANES;
      store_first(density + at, densities_at(factors, places + 3 * at, here), here);
    }
  });
}

void volume_blend(std::size_t rays, const std::int64_t* offsets, const std::int64_t* shown_offsets,
                  const float* weights, float least, const float* colors, const float* alpha, const float* background,
                  float* blended) {
  parallel_ranges(rays, 4 * RAYS, [=](std::size_t begin, std::size_t end) {
    for (std::size_t ray = begin; ray < end; ray++) {
      float sum[3] = {0.f, 0.f, 0.f};
      std::int64_t row = shown_offsets[ray];
      for (std::int64_t at = offsets[ray]; at < offsets[ray + 1] && row < shown_offsets[ray + 1]; at++)
        if (weights[at] > least) {
          for (int c = 0; c < 3; c++) sum[c] += weights[at] * colors[3 * row + c];
          row++;
        }
      for (int c = 0; c < 3; c++) blended[3 * ray + c] = sum[c] + (1.f - alpha[ray]) * background[c];
    }
  });
}

void volume_unblend(std::size_t rays, const std::int64_t* offsets, const std::int64_t* shown_offsets,
                    const VolumeSamples& samples, float least, const float* colors, const float* background,
                    const float* grad_color, const float* grad_alpha, const float* grad_depth, float* grad_colors,
                    float* grad_density) {
  parallel_ranges(rays, 4 * RAYS, [=](std::size_t begin, std::size_t end) {
    for (std::size_t ray = begin; ray < end; ray++) {
      const float* grad = grad_color + 3 * ray;
      float of_alpha = grad_alpha ? grad_alpha[ray] : 0.f;
      for (int c = 0; c < 3; c++) of_alpha -= grad[c] * background[c];
      const float of_depth = grad_depth ? grad_depth[ray] : 0.f;
      float behind = 0.f;  // the sum of weight times its gradient over the samples behind
      std::int64_t row = shown_offsets[ray + 1];
      for (std::int64_t at = offsets[ray + 1] - 1; at >= offsets[ray]; at--) {
        const float weight = samples.weights[at];
        float of_weight = of_alpha + of_depth * samples.along[at];
        if (weight > least && row > shown_offsets[ray]) {
          row--;
          for (int c = 0; c < 3; c++) {
            of_weight += grad[c] * colors[3 * row + c];
            grad_colors[3 * row + c] = grad[c] * weight;
          }
        }
        // Behind the ray's end slopes are zero, and so are weights.
        grad_density[at] = (samples.left[at] * of_weight - behind) * samples.slopes[at];
        behind += weight * of_weight;
      }
    }
  });
}

}  // namespace ringlight::RINGLIGHT_ISA
