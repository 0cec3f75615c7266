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

// Of planes that are a picture's.
static inline void pack(const ReflectionShape& shape, const ReflectionView& view,
                        const ReflectionBuffers<const float>& planes, const PackedPixels& pixels,
                        const PackedSurfaces& to) {
  pack_centers(view.camera.width, pixels, to.x, to.y);
  for_each_row(shape, planes, to.values,
               [&](const float* plane, float* row) { pack(plane, planes.plane, pixels, row); });
}

// Where every channel lies in blocks and in rows.
template <class Float>
struct ChannelRows {
  static constexpr int MOST = 3 + 3 + convention::REFLECTION_MAX_LATENTS + 2;
  Float* first[MOST];  // in the first block
  float* row[MOST];
  int count = 0;
  std::size_t block;

  ChannelRows(const ReflectionShape& shape, const ReflectionBuffers<Float>& blocks,
              const ReflectionBuffers<float>& rows) : block(blocks.block) {
    for_each_row(shape, blocks, rows, [&](Float* channel, float* to) { first[count] = channel, row[count++] = to; });
  }
};

// Of pixels that lie block by block: one run of memory for each block.
static inline void pack_blocks(const ReflectionView& view, const ChannelRows<const float>& from,
                               const PackedPixels& pixels, const PackedSurfaces& to) {
  pack_tile_centers(view.camera.width, pixels, to.x, to.y);
  constexpr int AHEAD = 6;  // blocks: about the latency of memory
  int step = 0;
  pixels.for_each_step([&](std::size_t first, unsigned on, int place) {
    const std::size_t at = first / LANES * from.block, later = pixels.later(step++, AHEAD) / LANES * from.block;
    for (int c = 0; c < from.count; c++) __builtin_prefetch(from.first[c] + later);
    for (int c = 0; c < from.count; c++) store(from.row[c] + place, pack_lanes(load(from.first[c] + at), on));
  });
  for (int c = 0; c < from.count; c++) fill_up(pixels.count(), from.row[c]);
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
