#include "reflection.hpp"

#include "parallel.hpp"
#include "reflection_batch.hpp"
#include "scratch.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

constexpr std::size_t PIXELS_PER_PIECE = 4096;  // a fraction of a millisecond, and its planes fit the second cache

void write(const ReflectionScene& scene, const ReflectionBatch& batch, float* color) {
  const std::size_t plane = scene.buffers.plane;
  for (int half = 0; half < HALVES; half++) {
    const PixelLanes& at = batch.pixels[half];
    const Vec alpha = take(scene.buffers.alpha, at);
    for (int c = 0; c < 3; c++)
      put(color + c * plane, at,
          fma(alpha, load(batch.added + c * GROUP + half * LANES), take(scene.buffers.rgb + c * plane, at)));
  }
}

}  // namespace

void reflection_forward(const ReflectionShape& shape, const ReflectionParameters<const float>& parameters,
                        const ReflectionView& view, const ReflectionBuffers<const float>& buffers, float* color) {
  Arena counter{nullptr};
  prepare(shape, parameters, counter);
  const Scratch prepared(counter.used * sizeof(float));
  Arena arena{prepared.floats()};
  const ReflectionTables tables = prepare(shape, parameters, arena);
  const ReflectionScene scene{shape, parameters, view, buffers, tables};
  const std::size_t pixels = static_cast<std::size_t>(view.width) * view.height;
  parallel_ranges(pixels, PIXELS_PER_PIECE, [&](std::size_t begin, std::size_t end) {
    for (int c = 0; c < 3; c++)
      std::memcpy(color + c * pixels + begin, buffers.rgb + c * pixels + begin, (end - begin) * sizeof(float));
    std::int32_t covered[PIXELS_PER_PIECE];
    const int count = static_cast<int>(list_covered(buffers.alpha, begin, end, view.faintest, covered));
    if (!count) return;
    ReflectionBatch batch;
    Arena needed{nullptr};
    lay_out(batch, shape, false, needed);
    const Scratch memory(needed.used * sizeof(float));
    Arena scratch{memory.floats()};
    lay_out(batch, shape, false, scratch);
    const MatrixUnit unit;
    for (int first = 0; first < count; first += GROUP) {
      const int next = first + GROUP;
      prefetch_planes(shape, buffers, covered + next, count - next < GROUP ? count - next : GROUP);
      evaluate<false>(scene, covered + first, count - first < GROUP ? count - first : GROUP, batch);
      write(scene, batch, color);
    }
  });
}

}  // namespace ringlight::RINGLIGHT_ISA
