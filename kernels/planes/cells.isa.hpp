// Where sixteen points fall between the nodes of a plane and of a line.
#pragma once
#include <cstddef>
#include <cstdint>

#include "planes/planes.hpp"
#include "simd/row_columns.isa.hpp"
#include "simd/simd.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

// Axes of each pair: the plane's first and second, and the line's.
constexpr int PAIR_AXES[PLANE_PAIRS][3] = {{0, 1, 2}, {0, 2, 1}, {1, 2, 0}};

// The nodes before sixteen coordinates, and the shares of those after them.
struct Between {
  alignas(64) std::int32_t node[LANES];
  alignas(64) float share[LANES];
};

RINGLIGHT_INLINE void place(Vec coordinate, int nodes, Between& found) {
  const float last = static_cast<float>(nodes - 1);
  // In this order what is not a number becomes the first node.
  const Vec at = min(max(fma(coordinate, Vec(0.5f * last), Vec(0.5f * last)), Vec(0.f)), Vec(last));
  const Vec node = min(floor(at), Vec(last - 1.f));
  store(found.node, truncate(node));
  store(found.share, at - node);
}

struct PlaneCells {
  Between across, down, along;
};

static inline void find_cells(const PairSize& size, int pair, const Vec coordinates[3], PlaneCells& found) {
  place(coordinates[PAIR_AXES[pair][0]], size.across, found.across);
  place(coordinates[PAIR_AXES[pair][1]], size.down, found.down);
  place(coordinates[PAIR_AXES[pair][2]], size.along, found.along);
}

// Of one point: the first floats of the plane's four nodes and of the line's two, and their weights.
struct Corners {
  std::size_t plane[4], line[2];
  Vec of_plane[4], of_line[2];
};

RINGLIGHT_INLINE Corners corners(const PairSize& size, int channels, const PlaneCells& cells, int lane) {
  const float right = cells.across.share[lane], below = cells.down.share[lane], after = cells.along.share[lane];
  const float left = 1.f - right, above = 1.f - below;
  const std::size_t width = channels, row = size.across * width;
  const std::size_t first = cells.down.node[lane] * row + cells.across.node[lane] * width;
  const std::size_t line = cells.along.node[lane] * width;
  return {{first, first + width, first + row, first + row + width},
          {line, line + width},
          {Vec(left * above), Vec(right * above), Vec(left * below), Vec(right * below)},
          {Vec(1.f - after), Vec(after)}};
}

// Channels of a block that begins at `channel`, and what is loaded and stored of them.
RINGLIGHT_INLINE int block_width(int channels, int channel) {
  return channels - channel < LANES ? channels - channel : LANES;
}
RINGLIGHT_INLINE Vec load_block(const float* from, int width) {
  return width == LANES ? load(from) : load_first(from, width);
}
RINGLIGHT_INLINE void store_block(float* to, Vec values, int width) {
  if (width == LANES)
    store(to, values);
  else
    store_first(to, values, width);
}

// Sixteen channels of the plane and of the line, from the block's first channel on.
RINGLIGHT_INLINE Vec plane_value(const Corners& at, const float* plane, int width) {
  Vec value = at.of_plane[0] * load_block(plane + at.plane[0], width);
  for (int k = 1; k < 4; k++) value = fma(at.of_plane[k], load_block(plane + at.plane[k], width), value);
  return value;
}
RINGLIGHT_INLINE Vec line_value(const Corners& at, const float* line, int width) {
  const Vec after = load_block(line + at.line[1], width);
  return fma(at.of_line[0], load_block(line + at.line[0], width), at.of_line[1] * after);
}

}  // namespace ringlight::RINGLIGHT_ISA
