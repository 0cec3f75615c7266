// Sixteen rows of any width up to sixteen floats, as columns and back.
#pragma once
#include "simd/simd.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

// Sixteen rows of `width` floats as columns; rows from `count` on are those of the last one, and columns from
// `width` on are anything.
RINGLIGHT_INLINE void take_columns(const float* rows, int width, int count, Vec* columns) {
  if (count == LANES && width == 3) return load_columns(rows, columns[0], columns[1], columns[2]);
  if (count == LANES && width == 4) return load_columns(rows, columns[0], columns[1], columns[2], columns[3]);
  if (count == LANES && width == 8 && load_eights(rows, columns)) return;
  for (int i = 0; i < LANES; i++) columns[i] = load_first(rows + (i < count ? i : count - 1) * width, width);
  transpose(columns);
}

// The way back; `columns` are lost. Whole vectors are several times faster to store than parts: what lies beyond a row
// is the next one's, which follows, as long as that is one of these.
RINGLIGHT_INLINE void put_columns(float* rows, int width, int count, Vec* columns) {
  if (count == LANES && width == 3) return store_columns(rows, columns[0], columns[1], columns[2]);
  if (count == LANES && width == 4) return store_columns(rows, columns[0], columns[1], columns[2], columns[3]);
  if (count == LANES && width == 8 && store_eights(rows, columns)) return;
  transpose(columns);
  int i = 0;
  for (; i * width + LANES <= count * width; i++) store(rows + i * width, columns[i]);
  for (; i < count; i++) store_first(rows + i * width, columns[i], width);
}

}  // namespace ringlight::RINGLIGHT_ISA
