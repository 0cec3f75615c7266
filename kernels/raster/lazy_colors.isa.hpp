// Colours that the blend asks for when a row first touches a block that has not ended yet: of a dense scene most rows
// never do, and a light field is dear. Which rows a tile asks for depends on this tile alone.
#pragma once
#include "raster/raster.hpp"

namespace ringlight::RINGLIGHT_ISA {

// Where a record keeps them.
constexpr RecordField LATE_FIELDS[LATE_CHANNELS] = {LATE_FIRST, LATE_SECOND, LATE_THIRD};

RINGLIGHT_INLINE float* record_of(const Frame& frame, std::uint32_t row) {
  return frame.records + std::size_t{row} * RECORD;
}

RINGLIGHT_INLINE bool is_known(const float* record) {
  float first;
  __atomic_load(record + LATE_FIRST, &first, __ATOMIC_ACQUIRE);
  return first != NOT_LIT;
}

// Another thread may work out the same row at the same time: both write the same bits, the first colour last, and none
// reads the others before. Whoever copies whole records meanwhile uses these fields of the copy, and the channels, for
// nothing that counts. The backward pass finds colours where channels are.
RINGLIGHT_INLINE void publish(const Frame& frame, const std::int32_t* rows, int count, const float* colors) {
  float* const kept = frame.late->kept;
  for (int i = 0; i < count; i++) {
    const auto row = static_cast<std::uint32_t>(rows[i]);
    float* const record = record_of(frame, row);
    for (int c = LATE_CHANNELS - 1; c >= 0; c--) {
      const float* const color = colors + LATE_CHANNELS * i + c;
      if (kept) {
        __atomic_store(record + FIRST_CHANNELS + c, color, __ATOMIC_RELAXED);
        __atomic_store(kept + LATE_CHANNELS * std::size_t{row} + c, color, __ATOMIC_RELAXED);
      }
      __atomic_store(record + LATE_FIELDS[c], color, __ATOMIC_RELEASE);
    }
  }
}

// What a chunk asks for: entries that touch a block. Behind its `count` entries lie the rest of the tile's.
struct LateChunk {
  const std::uint64_t *entries, *masks;
  int count;
  std::uint32_t left_in_tile;
  float* rows;  // copies of the records, [count RECORD]: where the colours go

  std::uint32_t row(std::uint32_t i) const { return static_cast<std::uint32_t>(entries[i]); }
  bool asks(std::uint32_t i) const { return masks[i] != 0; }
};

// Nobody could foretell which entries ask, hence no branches on it.
static void add_late_colors(const Frame& frame, const LateChunk& chunk, float* scratch) {
  std::int32_t wanted[CHUNK + LATE_GROUP];
  int held = 0;
  const auto want = [&](std::uint32_t i, bool asks) {
    wanted[held] = static_cast<std::int32_t>(chunk.row(i));
    held += asks & !is_known(record_of(frame, chunk.row(i)));
  };
  const auto count = static_cast<std::uint32_t>(chunk.count);
  for (std::uint32_t i = 0; i < count; i++) want(i, chunk.asks(i));
  // The rest of a group costs nothing, and what comes next is likely to ask.
  for (std::uint32_t i = count; i < chunk.left_in_tile && held % LATE_GROUP; i++) want(i, true);
  for (int first = 0; first < held; first += LATE_ROWS) {
    float colors[LATE_CHANNELS * LATE_ROWS];
    const int lot = held - first < LATE_ROWS ? held - first : LATE_ROWS;
    frame.late->light(frame.late->source, wanted + first, lot, colors, scratch);
    publish(frame, wanted + first, lot, colors);
  }
  float zero = 0;
  for (std::uint32_t i = 0; i < count; i++) {
    const float* const from = record_of(frame, chunk.row(i));
    float* const to = chunk.rows + i * RECORD + FIRST_CHANNELS;
    const bool lit = chunk.asks(i);
    for (int c = 0; c < LATE_CHANNELS; c++) {
      float color;
      __atomic_load(from + LATE_FIELDS[c], &color, __ATOMIC_RELAXED);
      to[c] = lit ? color : to[c];
      zero += (lit ? color : 0.f) * 0.f;
    }
  }
  // Of rows that ask alone: which others were lit is a matter of time.
  if (!(zero >= 0)) __atomic_store_n(frame.late_broken, true, __ATOMIC_RELAXED);
}

}  // namespace ringlight::RINGLIGHT_ISA
