#include "ring/ring.hpp"

#include <cstring>

#include "machine/parallel.hpp"
#include "machine/scratch.isa.hpp"
#include "ring/batch.isa.hpp"
#include "ring/light_rows.isa.hpp"
#include "ring/product.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

constexpr std::size_t ROWS_PER_PIECE = 512;  // a fraction of a millisecond; scratch memory is made once a piece
constexpr std::size_t BASE_GRAIN = 16384;    // floats a piece of the base colours

// base + residual, in place of the base colour; the residual is weighed first where the modulation is a factor.
void finish(const Batch& batch, const RingShape& shape) {
  for (int i = 0; i < 3 * GROUP; i += LANES) {
    if (weighed(shape)) store(batch.residual + i, load(batch.residual + i) * load(batch.modulation + i % GROUP));
    // max first: a NaN is handed on
    const Vec sum = load(batch.base + i) + load(batch.residual + i);
    store(batch.base + i, shape.clamped ? min(Vec(1.f), max(Vec(0.f), sum)) : sum);
  }
}

void write(const Batch& batch, const RingShape& shape, const RingOutputs& outputs) {
  finish(batch, shape);
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

constexpr int TOGETHER = 2;  // groups

// Room for groups, and their layout in it.
struct Groups {
  LitGroup groups[TOGETHER];
  std::size_t floats;
  Groups(const RingShape& shape, float* memory) {
    Arena arena{memory};
    for (LitGroup& group : groups) {
      lay_out(group.batch, shape, false, arena);
      if (lit_by_rows<LayerTerms>(shape)) group.rows = lay_out_rows(shape, arena);
    }
    floats = arena.used;
  }
};

// What is packed of a field: these, of which one counts, and behind them what they point at, but for what lies in the
// parameters.
struct PackedField {
  RingPanels panels;
  RowField rows;
};

// The field as its kernels read it.
struct Field {
  const RingShape& shape;
  const RingParameters<const float>& parameters;
  const PackedField& packed;
};

template <class Terms>
RowField packed_rows(const RingShape& shape, const RingParameters<const float>& parameters, Arena& arena) {
  if constexpr (in_unit<Terms>) return pack_row_field<RowPairs, Terms>(shape, parameters, arena);
  return {};
}

// With a null memory it only counts.
std::size_t pack_field(const RingShape& shape, const RingParameters<const float>& parameters, float* memory) {
  Arena arena{memory};
  float* const head = arena.take(sizeof(PackedField) / sizeof(float));
  PackedField packed{};
  if (lit_by_rows<LayerTerms>(shape))
    packed.rows = packed_rows<LayerTerms>(shape, parameters, arena);
  else
    packed.panels = pack_layers(shape, parameters, arena);
  if (head) std::memcpy(head, &packed, sizeof packed);
  return arena.used;
}

const PackedField& field_in(const float* packed) { return *reinterpret_cast<const PackedField*>(packed); }

// Leaves the residual colours of groups by rows, where it can.
template <class Terms, int Count>
bool done_by_rows(LitGroup* groups, const Field& field) {
  if (!lit_by_rows<Terms>(field.shape)) return false;
  if constexpr (in_unit<Terms>) light_rows<TileSums, RowPairs, Terms, Count>(groups, field.shape, field.packed.rows);
  return true;
}

// Base and residual colours of rows[count], at most GROUP of them for each of the groups.
template <int Count>
void light_groups(LitGroup* groups, const Field& field, const RingScene& scene, const std::int32_t* rows, int count) {
  for (int i = 0; i < Count; i++) {
    const int left = count - i * GROUP;
    start(groups[i].batch, field.shape, scene, rows + i * GROUP, left < GROUP ? left : GROUP);
  }
  if (done_by_rows<LayerTerms, Count>(groups, field)) return;
  for (int i = 0; i < Count; i++) {
    multiply<false>(groups[i].batch, field.shape, field.parameters, field.packed.panels.tables);
    shade<false>(groups[i].batch, field.shape, field.packed.panels);
  }
}

// Calls run(batch, first) for each group of rows[count], once it holds their base and residual colours.
template <class Run>
void for_lit_groups(Groups& room, const Field& field, const RingScene& scene, const std::int32_t* rows,
                    std::size_t count, Run run) {
  constexpr int MOST = TOGETHER * GROUP;
  for (std::size_t first = 0; first < count; first += MOST) {
    const int held = count - first < MOST ? static_cast<int>(count - first) : MOST;
    if (held > GROUP)
      light_groups<TOGETHER>(room.groups, field, scene, rows + first, held);
    else
      light_groups<1>(room.groups, field, scene, rows + first, held);
    for (int i = 0; i * GROUP < held; i++) run(room.groups[i].batch, first + static_cast<std::size_t>(i * GROUP));
  }
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
  const Field field{shape, parameters, field_in(packed.floats())};
  parallel_ranges(scene.visible_count, ROWS_PER_PIECE, [&](std::size_t begin, std::size_t end) {
    const Scratch memory(ring_light_floats(shape) * sizeof(float));
    Groups room(shape, memory.floats());
    const MatrixUnit unit;
    for_lit_groups(room, field, scene, scene.visible + begin, end - begin,
                   [&](const Batch& batch, std::size_t) { write(batch, shape, outputs); });
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

std::size_t ring_light_floats(const RingShape& shape) { return Groups(shape, nullptr).floats; }

void ring_light(const void* packed_ring, const std::int32_t* rows, int count, float* colors, float* scratch) {
  const PackedRing& ring = *static_cast<const PackedRing*>(packed_ring);
  Groups room(ring.shape, scratch);
  const Field field{ring.shape, ring.parameters, field_in(ring.packed)};
  prefetch_rows(ring, rows, count);
  const MatrixUnit unit;
  const auto hand_over = [=, &ring](const Batch& batch, std::size_t first) {
    finish(batch, ring.shape);
    for (int lane = 0; lane < batch.count; lane++)
      for (int c = 0; c < 3; c++) colors[3 * (first + lane) + c] = batch.base[c * GROUP + lane];
  };
  for_lit_groups(room, field, ring.scene, rows, static_cast<std::size_t>(count), hand_over);
}

}  // namespace ringlight::RINGLIGHT_ISA
