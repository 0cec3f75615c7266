#include "ring.hpp"

#include <cstring>

#include "parallel.hpp"
#include "ring_batch.hpp"
#include "ring_product.hpp"
#include "scratch.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

constexpr std::size_t ROWS_PER_PIECE = 512;  // a fraction of a millisecond; scratch memory is made once a piece
constexpr std::size_t BASE_GRAIN = 16384;    // floats a piece of the base colours

// base + residual, in place of the base colour.
void finish(const Batch& batch) {
  for (int i = 0; i < 3 * GROUP; i += LANES) {
    // max first: a NaN is handed on
    const Vec sum = load(batch.base + i) + load(batch.residual + i);
    store(batch.base + i, min(Vec(1.f), max(Vec(0.f), sum)));
  }
}

void write(const Batch& batch, const RingShape& shape, const RingOutputs& outputs) {
  finish(batch);
  if (batch.consecutive && !outputs.residual && !outputs.modulation) {
    for (int first = 0; first < GROUP; first += LANES)
      store_columns(outputs.color + 3 * (static_cast<std::size_t>(batch.rows[0]) + first), load(batch.base + first),
                    load(batch.base + GROUP + first), load(batch.base + 2 * GROUP + first));
    return;
  }
  for (int lane = 0; lane < batch.count; lane++) {
    const std::size_t row = batch.rows[lane];
    for (int c = 0; c < 3; c++) outputs.color[3 * row + c] = batch.base[c * GROUP + lane];
    if (outputs.residual)
      for (int c = 0; c < 3; c++) outputs.residual[3 * row + c] = batch.residual[c * GROUP + lane];
    if (outputs.modulation) outputs.modulation[row] = modulated(shape) ? batch.modulation[lane] : 1.f;
  }
}

void write_base_colors(const RingScene& scene, float* color) {
  parallel_ranges(3 * scene.count, BASE_GRAIN, [=](std::size_t begin, std::size_t end) {
    std::size_t i = begin;
    for (; i + LANES <= end; i += LANES) store(color + i, sigmoid(load(scene.base + i)));
    const int left = static_cast<int>(end - i);
    if (left) store_first(color + i, sigmoid(load_first(scene.base + i, left)), left);
  });
}

// Room for a group, and its layout in it.
struct Group {
  Batch batch;
  std::size_t floats;
  Group(const RingShape& shape, float* memory) {
    Arena arena{memory};
    lay_out(batch, shape, false, arena);
    floats = arena.used;
  }
};

// The field as its kernels read it: panels and behind them what they point at, but for what lies in the parameters.
struct Field {
  const RingShape& shape;
  const RingParameters<const float>& parameters;
  const RingPanels& panels;
};

// With a null memory it only counts.
std::size_t pack_field(const RingShape& shape, const RingParameters<const float>& parameters, float* memory) {
  Arena arena{memory};
  float* const head = arena.take(sizeof(RingPanels) / sizeof(float));
  const RingPanels panels = pack_layers(shape, parameters, arena);
  if (head) std::memcpy(head, &panels, sizeof panels);
  return arena.used;
}

const RingPanels& panels_in(const float* packed) { return *reinterpret_cast<const RingPanels*>(packed); }

// Base and residual colours of a group.
void light_group(Batch& batch, const Field& field, const RingScene& scene, const std::int32_t* rows, int count) {
  start(batch, field.shape, scene, rows, count);
  multiply<false>(batch, field.shape, field.parameters, field.panels.tables);
  shade<false>(batch, field.shape, field.panels);
}

// Calls run(first, count) for groups of so many rows.
template <class Run>
void for_each_group(std::size_t begin, std::size_t end, Run run) {
  for (std::size_t first = begin; first < end; first += GROUP)
    run(first, end - first < GROUP ? static_cast<int>(end - first) : GROUP);
}

}  // namespace

std::size_t ring_packed_floats(const RingShape& shape) { return pack_field(shape, {}, nullptr); }

void ring_pack(const RingShape& shape, const RingParameters<const float>& parameters, float* packed) {
  pack_field(shape, parameters, packed);
}

void ring_forward(const RingShape& shape, const RingParameters<const float>& parameters, const RingScene& scene,
                  const RingOutputs& outputs) {
  write_base_colors(scene, outputs.color);
  const Scratch packed(ring_packed_floats(shape) * sizeof(float));
  ring_pack(shape, parameters, packed.floats());
  const Field field{shape, parameters, panels_in(packed.floats())};
  parallel_ranges(scene.visible_count, ROWS_PER_PIECE, [&](std::size_t begin, std::size_t end) {
    const Scratch memory(ring_light_floats(shape) * sizeof(float));
    Group group(shape, memory.floats());
    const MatrixUnit unit;
    for_each_group(begin, end, [&](std::size_t first, int count) {
      light_group(group.batch, field, scene, scene.visible + first, count);
      write(group.batch, shape, outputs);
    });
  });
}

// They come from all over the table.
static void prefetch_rows(const PackedRing& ring, const std::int32_t* rows, int count) {
  const RingScene& scene = ring.scene;
  for (int i = 0; i < count; i++) {
    const auto row = static_cast<std::size_t>(rows[i]);
    __builtin_prefetch(scene.means + 3 * row);
    __builtin_prefetch(scene.base + 3 * row);
    __builtin_prefetch(scene.latents + ring.shape.latents * row);
  }
}

std::size_t ring_light_floats(const RingShape& shape) { return Group(shape, nullptr).floats; }

void ring_light(const void* packed_ring, const std::int32_t* rows, int count, float* colors, float* scratch) {
  const PackedRing& ring = *static_cast<const PackedRing*>(packed_ring);
  Group group(ring.shape, scratch);
  const Batch& batch = group.batch;
  const Field field{ring.shape, ring.parameters, panels_in(ring.packed)};
  prefetch_rows(ring, rows, count);
  const MatrixUnit unit;
  for_each_group(0, static_cast<std::size_t>(count), [&](std::size_t first, int held) {
    light_group(group.batch, field, ring.scene, rows + first, held);
    finish(batch);
    for (int lane = 0; lane < held; lane++)
      for (int c = 0; c < 3; c++) colors[3 * (first + lane) + c] = batch.base[c * GROUP + lane];
  });
}

}  // namespace ringlight::RINGLIGHT_ISA
