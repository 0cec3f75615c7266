// Rows of a table between its nodes, one per lane, and the way back: gradients added to the rows they came from. A
// row is consecutive in memory and a lane array is not, so sixteen by sixteen floats are transposed at a time.
#pragma once
#include "dense/lane_layers.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

// Sixteen components, or the last few of a row.
struct WholePart {
  Vec from(const float* values) const { return load(values); }
  template <class Values>
  void put(float* to, Values value) const { store(to, value); }
};
struct LastPart {
  int count;
  Vec from(const float* values) const { return load_first(values, count); }
  void put(float* to, Vec value) const { store_first(to, value, count); }
};

template <class Each>
static inline __attribute__((always_inline)) void each_part(int width, Each each) {
  int first = 0;
  for (; first + LANES <= width; first += LANES) each(first, WholePart{});
  if (first < width) each(first, LastPart{width - first});
}

// Where sixteen coordinates of [-1, 1] fall among `nodes` nodes, the first and last on the ends.
struct Cells {
  alignas(64) std::int32_t cell[LANES];  // the node below, at most nodes - 2
  alignas(64) float fraction[LANES];     // of the way to the next
};

// Beyond the ends becomes the end, NaN becomes -1, so that no table is read outside whatever the input.
static inline void locate(Vec coordinates, int nodes, Cells& cells) {
  const Vec inside = min(max(coordinates, Vec(-1.f)), Vec(1.f));
  const Vec position = (inside + Vec(1.f)) * Vec(0.5f * static_cast<float>(nodes - 1));
  const Vec cell = min(floor(position), Vec(static_cast<float>(nodes - 2)));
  store(cells.cell, truncate(cell));
  store(cells.fraction, position - cell);
}

// Linear interpolation in a table [nodes][width]. corner() and add() see 16 columns from `column`.
struct AxisTable {
  int width;
  const Cells& cells;

  const float* row(const float* table, int lane) const {
    return table + static_cast<std::size_t>(cells.cell[lane]) * width;
  }
  template <class Values, class Load>
  __attribute__((always_inline)) Values between(const float* table, int lane, Load load_at) const {
    const float* at = row(table, lane);
    const Values below = load_at(at);
    return below + Values(cells.fraction[lane]) * (load_at(at + width) - below);
  }
  template <class Values, class Add>
  __attribute__((always_inline)) void scatter(float* table, int lane, Values gradient, Add add_at) const {
    float* at = table + (row(table, lane) - table);
    const Values above = gradient * Values(cells.fraction[lane]);
    add_at(at, gradient - above);
    add_at(at + width, above);
  }
};

// Bilinear interpolation in a square map [side * side][width], row j * side + i for node (i, j).
struct MapTable {
  int width, side;
  const Cells &across, &down;

  const float* row(const float* table, int lane) const {
    return table + (static_cast<std::size_t>(down.cell[lane]) * side + across.cell[lane]) * width;
  }
  template <class Values, class Load>
  __attribute__((always_inline)) Values between(const float* table, int lane, Load load_at) const {
    const float *upper = row(table, lane), *lower = upper + static_cast<std::size_t>(side) * width;
    const Values right(across.fraction[lane]), first = load_at(upper), second = load_at(lower);
    const Values above = first + right * (load_at(upper + width) - first);
    const Values below = second + right * (load_at(lower + width) - second);
    return above + Values(down.fraction[lane]) * (below - above);
  }
  template <class Values, class Add>
  __attribute__((always_inline)) void scatter(float* table, int lane, Values gradient, Add add_at) const {
    float* upper = table + (row(table, lane) - table);
    float* lower = upper + static_cast<std::size_t>(side) * width;
    const Values right(across.fraction[lane]);
    const Values below = gradient * Values(down.fraction[lane]), above = gradient - below;
    add_at(upper, above - above * right);
    add_at(upper + width, above * right);
    add_at(lower, below - below * right);
    add_at(lower + width, below * right);
  }
};

// lanes[width][16] = the interpolated rows.
template <class Table>
static void read_table(const Table& at, const float* table, float* lanes) {
  int column = 0;
  for (; column + LANES <= at.width; column += LANES) {
    Vec square[LANES];
    for (int lane = 0; lane < LANES; lane++)
      square[lane] = at.template between<Vec>(table + column, lane, [](const float* from) { return load(from); });
    transpose(square);
    for (int i = 0; i < LANES; i++) store(lanes + (column + i) * LANES, square[i]);
  }
  for (; column < at.width; column++)
    for (int lane = 0; lane < LANES; lane++)
      lanes[column * LANES + lane] =
          at.template between<float>(table + column, lane, [](const float* from) { return *from; });
}

// The way back of read_table: adds to the rows of `table`, lane after lane.
template <class Table>
static void add_to_table(const Table& at, float* table, const float* lanes) {
  int column = 0;
  for (; column + LANES <= at.width; column += LANES) {
    Vec square[LANES];
    for (int i = 0; i < LANES; i++) square[i] = load(lanes + (column + i) * LANES);
    transpose(square);
    for (int lane = 0; lane < LANES; lane++)
      at.template scatter<Vec>(table + column, lane, square[lane],
                              [](float* to, Vec value) { store(to, load(to) + value); });
  }
  for (; column < at.width; column++)
    for (int lane = 0; lane < LANES; lane++)
      at.template scatter<float>(table + column, lane, lanes[column * LANES + lane],
                                [](float* to, float value) { *to += value; });
}

}  // namespace ringlight::RINGLIGHT_ISA
