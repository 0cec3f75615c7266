// What the reflection shader reads of packed pixels and hands back, row by row.
#pragma once
#include "reflection/packed_pixels.isa.hpp"
#include "reflection/pixels.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

// The planes of packed pixels, a row each.
static inline ReflectionBuffers<float> lay_out_rows(const ReflectionShape& shape, bool depth, Arena& arena) {
  const auto rows = [&](int count) { return arena.take(count * PACKED_ROW); };
  ReflectionBuffers<float> to{};
  to.rgb = rows(3), to.normal = rows(3), to.latents = rows(shape.latents), to.alpha = rows(1);
  if (depth) to.depth = rows(1);
  to.plane = PACKED_ROW;
  return to;
}

// Calls body(plane, row) for every plane of the pictures and its row.
template <class Float, class F>
RINGLIGHT_INLINE void for_each_row(const ReflectionShape& shape, const ReflectionBuffers<Float>& planes,
                                   const ReflectionBuffers<float>& rows, F&& body) {
  const auto each = [&](Float* plane, float* row, int count) __attribute__((always_inline)) {
    for (int i = 0; i < count; i++) body(plane + i * planes.plane, row + i * rows.plane);
  };
  each(planes.rgb, rows.rgb, 3);
  each(planes.normal, rows.normal, 3);
  each(planes.latents, rows.latents, shape.latents);
  each(planes.alpha, rows.alpha, 1);
  if (rows.depth) each(planes.depth, rows.depth, 1);
}

struct PackedSurfaces {
  float *x, *y;  // pixel centres
  ReflectionBuffers<float> values;
};

static inline PackedSurfaces lay_out_surfaces(const ReflectionShape& shape, Arena& arena) {
  float *x = arena.take(PACKED_ROW), *y = arena.take(PACKED_ROW);
  return {x, y, lay_out_rows(shape, reads_depth(shape), arena)};
}

// Of planes that are a picture's, or tile by tile.
static inline void pack(const ReflectionShape& shape, const ReflectionView& view,
                        const ReflectionBuffers<const float>& planes, bool by_tile, const PackedPixels& pixels,
                        const PackedSurfaces& to) {
  by_tile ? pack_tile_centers(view.camera.width, pixels, to.x, to.y)
          : pack_centers(view.camera.width, pixels, to.x, to.y);
  for_each_row(shape, planes, to.values,
               [&](const float* plane, float* row) { pack(plane, planes.plane, pixels, row); });
}

// Every row from `place` on.
template <class Float>
static inline ReflectionBuffers<Float> from_place(const ReflectionBuffers<float>& rows, int place) {
  return {rows.rgb + place, rows.normal + place, rows.latents + place, rows.depth ? rows.depth + place : nullptr,
          rows.alpha + place, rows.plane};
}

static inline PixelLanes lanes_at(const PackedSurfaces& surfaces, int place) {
  return {load(surfaces.x + place), load(surfaces.y + place), from_place<const float>(surfaces.values, place)};
}

}  // namespace ringlight::RINGLIGHT_ISA
