// Colours that the blend asks for when a row first touches a block that is not finished: of a dense scene most rows
// never do, and a light field is dear. Which rows a tile asks for depends on this tile alone.
#pragma once
#include "raster/raster.hpp"

namespace ringlight::RINGLIGHT_ISA {

// Where a record keeps them.
constexpr RecordField LAZY_FIELDS[LAZY_CHANNELS] = {LAZY_FIRST, LAZY_SECOND, LAZY_THIRD};

RINGLIGHT_INLINE float* record_of(const View& view, std::uint32_t row) {
  return view.records + std::size_t{row} * RECORD;
}

RINGLIGHT_INLINE bool is_known(const float* record) {
  float first;
  __atomic_load(record + LAZY_FIRST, &first, __ATOMIC_ACQUIRE);
  return first != NOT_LIT;
}

// Two threads may work out the same row at the same time: both write the same bits, the first colour last, and neither
// is read before. A record that is copied meanwhile may hold part of a colour: these fields of a copy, and its
// channels, count for nothing. The backward pass finds colours where channels are.
RINGLIGHT_INLINE void publish(const View& view, const std::int32_t* rows, int count, const float* colors) {
  float* const kept = view.lazy->kept;
  for (int i = 0; i < count; i++) {
    const auto row = static_cast<std::uint32_t>(rows[i]);
    float* const record = record_of(view, row);
    for (int c = LAZY_CHANNELS - 1; c >= 0; c--) {
      const float* const color = colors + LAZY_CHANNELS * i + c;
      if (kept) {
        __atomic_store(record + FIRST_CHANNELS + c, color, __ATOMIC_RELAXED);
        __atomic_store(kept + LAZY_CHANNELS * std::size_t{row} + c, color, __ATOMIC_RELAXED);
      }
      __atomic_store(record + LAZY_FIELDS[c], color, __ATOMIC_RELEASE);
    }
  }
}

// What a chunk asks for: entries that touch a block. Behind its `count` entries lie the rest of the tile's.
struct LazyChunk {
  const std::uint64_t *entries, *masks;
  int count;
  std::uint32_t left_in_tile;
  float* rows;  // copies of the records, [count RECORD]: where the colours go

  std::uint32_t row(std::uint32_t i) const { return static_cast<std::uint32_t>(entries[i]); }
  bool asks(std::uint32_t i) const { return masks[i] != 0; }
};

// No branches on which entries ask: a processor cannot foretell it.
static void add_lazy_colors(const View& view, const LazyChunk& chunk, float* scratch) {
  std::int32_t wanted[CHUNK + LAZY_GROUP];
  int held = 0;
  const auto want = [&](std::uint32_t i, bool asks) {
    wanted[held] = static_cast<std::int32_t>(chunk.row(i));
    held += asks & !is_known(record_of(view, chunk.row(i)));
  };
  const auto count = static_cast<std::uint32_t>(chunk.count);
  for (std::uint32_t i = 0; i < count; i++) want(i, chunk.asks(i));
  // The rest of a group costs nothing, and what comes next is likely to ask.
  for (std::uint32_t i = count; i < chunk.left_in_tile && held % LAZY_GROUP; i++) want(i, true);
  for (int first = 0; first < held; first += LAZY_ROWS) {
    float colors[LAZY_CHANNELS * LAZY_ROWS];
    const int batch = held - first < LAZY_ROWS ? held - first : LAZY_ROWS;
    view.lazy->light(view.lazy->source, wanted + first, batch, colors, scratch);
    publish(view, wanted + first, batch, colors);
  }
  float zero = 0;
  for (std::uint32_t i = 0; i < count; i++) {
    const float* const from = record_of(view, chunk.row(i));
    float* const to = chunk.rows + i * RECORD + FIRST_CHANNELS;
    const bool lit = chunk.asks(i);
    for (int c = 0; c < LAZY_CHANNELS; c++) {
      float color;
      __atomic_load(from + LAZY_FIELDS[c], &color, __ATOMIC_RELAXED);
      to[c] = lit ? color : to[c];
      zero += (lit ? color : 0.f) * 0.f;
    }
  }
  // Of rows that ask alone: which others were lit is a matter of time.
  if (!(zero >= 0)) __atomic_store_n(view.lazy_broken, true, __ATOMIC_RELAXED);
}

}  // namespace ringlight::RINGLIGHT_ISA
