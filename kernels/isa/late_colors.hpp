// Colours that the blend asks for when a row first touches a block that is not dark yet: of a dense scene most rows
// never do, and a light field is dear. Which rows a tile asks for depends on this tile alone.
#pragma once
#include "raster.hpp"

namespace ringlight::RINGLIGHT_ISA {

// The last float of a row's four says whether the colour before it is known.
constexpr int LATE_FLOATS = LATE_CHANNELS + 1;
constexpr std::uint32_t KNOWN = 1;

static inline float* late_color(const Frame& frame, std::uint32_t row) {
  return frame.late_colors + LATE_FLOATS * static_cast<std::size_t>(row);
}
static inline std::uint32_t* late_mark(const Frame& frame, std::uint32_t row) {
  return reinterpret_cast<std::uint32_t*>(late_color(frame, row) + LATE_CHANNELS);
}

// Another thread may work out the same row at the same time. Both write the same bits, and nobody reads them before the
// mark that is set behind them.
static inline void publish_colors(const Frame& frame, const std::int32_t* rows, int count, const float* colors) {
  float zero = 0;
  for (int i = 0; i < LATE_CHANNELS * count; i++) zero += colors[i] * 0.f;
  if (!(zero >= 0)) __atomic_store_n(frame.late_broken, true, __ATOMIC_RELAXED);
  for (int i = 0; i < count; i++) {
    const auto row = static_cast<std::uint32_t>(rows[i]);
    for (int c = 0; c < LATE_CHANNELS; c++)
      __atomic_store(late_color(frame, row) + c, colors + LATE_CHANNELS * i + c, __ATOMIC_RELAXED);
    __atomic_store_n(late_mark(frame, row), KNOWN, __ATOMIC_RELEASE);
  }
}

// What a chunk asks for: entries whose mask has a bright block.
struct LateChunk {
  const std::uint64_t *entries, *masks;
  std::uint64_t bright;
  int count;
  float* rows;  // copies of the records, [count RECORD]: where the colours go

  std::uint32_t row(int i) const { return static_cast<std::uint32_t>(entries[i]); }
  bool asks(int i) const { return (masks[i] & bright) != 0; }
};

// Nobody could foretell which entries ask, hence no branches on it.
static void add_late_colors(const Frame& frame, const LateChunk& chunk, float* scratch) {
  std::int32_t wanted[CHUNK];
  int held = 0;
  for (int i = 0; i < chunk.count; i++) {
    wanted[held] = static_cast<std::int32_t>(chunk.row(i));
    held += chunk.asks(i) & (__atomic_load_n(late_mark(frame, chunk.row(i)), __ATOMIC_ACQUIRE) != KNOWN);
  }
  for (int first = 0; first < held; first += LATE_ROWS) {
    float colors[LATE_CHANNELS * LATE_ROWS];
    const int lot = held - first < LATE_ROWS ? held - first : LATE_ROWS;
    frame.late->light(frame.late->source, wanted + first, lot, colors, scratch);
    publish_colors(frame, wanted + first, lot, colors);
  }
  for (int i = 0; i < chunk.count; i++) {
    const float* const from = late_color(frame, chunk.row(i));
    float* const to = chunk.rows + i * RECORD + FIRST_CHANNELS;
    const bool lit = chunk.asks(i);
    for (int c = 0; c < LATE_CHANNELS; c++) {
      float color;
      __atomic_load(from + c, &color, __ATOMIC_RELAXED);
      to[c] = lit ? color : to[c];
    }
  }
}

}  // namespace ringlight::RINGLIGHT_ISA
