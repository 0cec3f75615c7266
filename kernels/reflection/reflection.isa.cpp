#include "reflection/reflection.hpp"

#include "machine/parallel.hpp"
#include "machine/scratch.isa.hpp"
#include "reflection/batch.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

constexpr std::size_t PIXELS_PER_PIECE = 4096;  // a fraction of a millisecond, and its planes fit the second cache

// What a piece has to itself.
struct Workplace {
  ReflectionBatch batch;
  PackedSurfaces surfaces;
  float* colors;  // [3] rows of packed pixels
};

Workplace lay_out_workplace(const ReflectionShape& shape, Arena& arena) {
  Workplace place;
  lay_out(place.batch, shape, false, arena);
  place.surfaces = lay_out_surfaces(shape, arena);
  place.colors = arena.take(3 * PACKED_ROW);
  return place;
}

void shade(const ReflectionScene& scene, const ReflectionBuffers<const float>& buffers, const PackedPixels& pixels,
           Workplace& place, float* color) {
  pack(scene.shape, scene.view, buffers, pixels, place.surfaces);
  const ReflectionBuffers<float>& values = place.surfaces.values;
  for (int first = 0; first < pixels.count(); first += GROUP) {
    evaluate<false>(scene, place.surfaces, first, place.batch);
    for (int lane = 0; lane < GROUP; lane += LANES) {
      const Vec alpha = load(values.alpha + first + lane);
      for (int c = 0; c < 3; c++) {
        const std::size_t at = c * PACKED_ROW + first + lane;
        store(place.colors + at, fma(alpha, load(place.batch.added + c * GROUP + lane), load(values.rgb + at)));
      }
    }
  }
  for (int c = 0; c < 3; c++) unpack(place.colors + c * PACKED_ROW, pixels, color + c * buffers.plane);
}

}  // namespace

void reflection_forward(const ReflectionShape& shape, const ReflectionParameters<const float>& parameters,
                        const ReflectionView& view, const ReflectionBuffers<const float>& buffers, float* color) {
  Arena counter{nullptr};
  prepare(shape, parameters, counter);
  const Scratch prepared(counter.used * sizeof(float));
  Arena arena{prepared.floats()};
  const ReflectionTables tables = prepare(shape, parameters, arena);
  const ReflectionScene scene{shape, parameters, view, tables};
  const std::size_t pixels = static_cast<std::size_t>(view.camera.width) * view.camera.height;
  parallel_ranges(pixels, PIXELS_PER_PIECE, [&](std::size_t begin, std::size_t end) {
    for (int c = 0; c < 3; c++)
      std::memcpy(color + c * pixels + begin, buffers.rgb + c * pixels + begin, (end - begin) * sizeof(float));
    std::size_t first = begin;
    while (first < end && !covered_lanes(buffers.alpha, first, end, view.faintest)) first += LANES;
    if (first >= end) return;  // nothing but background
    Arena needed{nullptr};
    lay_out_workplace(shape, needed);
    const Scratch memory(needed.used * sizeof(float));
    Arena scratch{memory.floats()};
    Workplace place = lay_out_workplace(shape, scratch);
    const MatrixUnit unit;
    PackedPixels packed;
    packed.clear();
    for (; first < end; first += LANES) {
      const unsigned on = covered_lanes(buffers.alpha, first, end, view.faintest);
      if (on) packed.add(static_cast<std::int32_t>(first), on);
      if (packed.has_room()) continue;
      shade(scene, buffers, packed, place, color);
      packed.clear();
    }
    if (packed.count()) shade(scene, buffers, packed, place, color);
  });
}

}  // namespace ringlight::RINGLIGHT_ISA
