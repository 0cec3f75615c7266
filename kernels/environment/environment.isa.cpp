#include <algorithm>
#include <cstring>

#include "environment/lookup.isa.hpp"
#include "machine/parallel.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

constexpr int ROWS_PER_PIECE = 8;

// Sixteen pixels of a row, or what is left of it.
struct Lanes {
  std::size_t at;  // in a plane
  int count;
  Vec x;           // pixel centres
  float y;
  unsigned covered;  // bits
};

// Calls body(lanes) for the pixels of a row.
template <class F>
RINGLIGHT_INLINE void for_each_lanes(const EnvironmentView& view, const float* alpha, int row, F&& body) {
  alignas(64) static const float centers[LANES] = {0.5f, 1.5f, 2.5f,  3.5f,  4.5f,  5.5f,  6.5f,  7.5f,
                                                   8.5f, 9.5f, 10.5f, 11.5f, 12.5f, 13.5f, 14.5f, 15.5f};
  const int width = view.camera.width;
  for (int column = 0; column < width; column += LANES) {
    Lanes lanes;
    lanes.at = static_cast<std::size_t>(row) * width + column;
    lanes.count = std::min(width - column, LANES);
    lanes.x = load(centers) + Vec(static_cast<float>(column)), lanes.y = row + 0.5f;
    const unsigned within = (1u << lanes.count) - 1;
    lanes.covered = within & bits(gt(load_first(alpha + lanes.at, lanes.count), Vec(view.faintest)));
    body(lanes);
  }
}

RINGLIGHT_INLINE void load_planes(const float* image, std::size_t plane, const Lanes& lanes, int first, int count,
                                  Vec* to) {
  for (int c = 0; c < count; c++) to[c] = load_first(image + (first + c) * plane + lanes.at, lanes.count);
}

RINGLIGHT_INLINE void store_planes(float* image, std::size_t plane, const Lanes& lanes, int first, int count,
                                   const Vec* from) {
  for (int c = 0; c < count; c++) store_first(image + (first + c) * plane + lanes.at, from[c], lanes.count);
}

std::size_t pixels_of(const Camera& camera) { return static_cast<std::size_t>(camera.width) * camera.height; }

}  // namespace

void environment_forward(const EnvironmentView& view, const CubemapSize& size, const EnvironmentPlanes& planes,
                         const float* colors, float* color) {
  const std::size_t plane = pixels_of(view.camera);
  const LaneFaces faces = same_faces(size);
  parallel_ranges(view.camera.height, ROWS_PER_PIECE, [&](std::size_t begin, std::size_t end) {
    for (std::size_t row = begin; row < end; row++)
      for_each_lanes(view, planes.alpha, static_cast<int>(row), [&](const Lanes& lanes) {
        Vec rgb[3], blended[3], strength;
        load_planes(planes.image, plane, lanes, RGB, 3, rgb);
        if (lanes.covered) {
          load_planes(planes.image, plane, lanes, NORMAL, 3, blended);
          load_planes(planes.image, plane, lanes, STRENGTH, 1, &strength);
          const Mirror pixel = mirror(view, lanes.x, lanes.y, blended);
          Looked looked;
          look(faces, colors, pixel.reflected, lanes.covered, looked);
          const Mask covered = mask_from_bits(lanes.covered);
          for (int c = 0; c < 3; c++)
            rgb[c] = select(covered, fma(strength, seen(looked, c) - rgb[c], rgb[c]), rgb[c]);
        }
        store_planes(color, plane, lanes, 0, 3, rgb);
      });
  });
}

void environment_backward(const EnvironmentView& view, const CubemapSize& size, const EnvironmentPlanes& planes,
                          const float* colors, const float* of_color, float* of_image, float* shards) {
  const std::size_t plane = pixels_of(view.camera);
  const LaneFaces faces = same_faces(size);
  const int height = view.camera.height;
  parallel_for(TEXEL_SHARDS, [&](std::size_t shard) {
    float* const of_texels = shards + shard * size.floats();
    std::memset(of_texels, 0, size.floats() * sizeof(float));
    // Bands of rows in turn, so that what covers a part of the picture is dealt to all.
    for (int row = 0; row < height; row++) {
      if (static_cast<std::size_t>(row / ROWS_PER_PIECE % TEXEL_SHARDS) != shard) continue;
      for_each_lanes(view, planes.alpha, row, [&](const Lanes& lanes) {
        Vec upstream[3], rgb[3], blended[3], strength, of_strength(0.f);
        load_planes(of_color, plane, lanes, 0, 3, upstream);
        Vec of_blended[3] = {Vec(0.f), Vec(0.f), Vec(0.f)};
        if (lanes.covered) {
          load_planes(planes.image, plane, lanes, RGB, 3, rgb);
          load_planes(planes.image, plane, lanes, NORMAL, 3, blended);
          load_planes(planes.image, plane, lanes, STRENGTH, 1, &strength);
          const Mask covered = mask_from_bits(lanes.covered);
          const Mirror pixel = mirror(view, lanes.x, lanes.y, blended);
          Looked looked;
          look(faces, colors, pixel.reflected, lanes.covered, looked);
          Vec of_seen[3], of_reflected[3];
          for (int c = 0; c < 3; c++) {
            of_strength = fma(upstream[c], seen(looked, c) - rgb[c], of_strength);
            of_seen[c] = keep(covered, upstream[c] * strength);
            upstream[c] = upstream[c] - of_seen[c];
          }
          of_strength = keep(covered, of_strength);
          look_gradient(looked, of_seen, of_reflected);
          mirror_gradient(pixel, of_reflected, of_blended);
          for (int c = 0; c < 3; c++) of_blended[c] = keep(covered, of_blended[c]);
          texel_gradient(faces, looked, of_seen, lanes.covered, of_texels);
        }
        store_planes(of_image, plane, lanes, RGB, 3, upstream);
        store_planes(of_image, plane, lanes, NORMAL, 3, of_blended);
        store_planes(of_image, plane, lanes, STRENGTH, 1, &of_strength);
      });
    }
  });
}

}  // namespace ringlight::RINGLIGHT_ISA
