#include "planes/planes.hpp"

#include "machine/parallel.hpp"
#include "planes/cells.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

// The coordinates of sixteen points, or of the `count` that are left.
int take_points(const float* points, std::size_t first, std::size_t end, Vec coordinates[LANES]) {
  const int count = end - first < LANES ? static_cast<int>(end - first) : LANES;
  take_columns(points + 3 * first, 3, count, coordinates);
  return count;
}

void clear_block(float* grid, std::size_t nodes, int channels, int width) {
  for (std::size_t node = 0; node < nodes; node++) store_block(grid + node * channels, Vec(0.f), width);
}

RINGLIGHT_INLINE bool is_zero(Vec values) {
  return bits(both(ge(values, Vec(0.f)), ge(Vec(0.f), values))) == 0xffff;
}

RINGLIGHT_INLINE void add_block(float* to, Vec weight, Vec values, int width) {
  store_block(to, fma(weight, values, load_block(to, width)), width);
}

// One pair's gradient in the channels of one block, all points in their order. The grids begin at the block's channel.
struct Block {
  int pair, width;
  const float *plane, *line;
  float *of_plane, *of_line;
};

void add_point(const Block& block, const Corners& at, Vec upstream) {
  const Vec of_plane = upstream * line_value(at, block.line, block.width);
  const Vec of_line = upstream * plane_value(at, block.plane, block.width);
  for (int k = 0; k < 4; k++) add_block(block.of_plane + at.plane[k], at.of_plane[k], of_plane, block.width);
  for (int k = 0; k < 2; k++) add_block(block.of_line + at.line[k], at.of_line[k], of_line, block.width);
}

}  // namespace

// Each piece owns a pair and a block of channels: nobody else writes there, and points come in their order.
void plane_gradient(const PlaneShape& shape, const PlaneGrids<const float>& grids, std::size_t count,
                    const float* points, const float* upstream, const PlaneGrids<float>& gradients) {
  const int channels = shape.channels, blocks = (channels + LANES - 1) / LANES;
  parallel_for(static_cast<std::size_t>(PLANE_PAIRS) * blocks, [&](std::size_t piece) {
    const int pair = static_cast<int>(piece) / blocks, channel = static_cast<int>(piece) % blocks * LANES;
    const PairSize& size = shape.pairs[pair];
    const Block block{pair,
                      block_width(channels, channel),
                      grids.planes[pair] + channel,
                      grids.lines[pair] + channel,
                      gradients.planes[pair] + channel,
                      gradients.lines[pair] + channel};
    clear_block(block.of_plane, static_cast<std::size_t>(size.across) * size.down, channels, block.width);
    clear_block(block.of_line, size.along, channels, block.width);
    for (std::size_t first = 0; first < count; first += LANES) {
      Vec coordinates[LANES];
      const int some = take_points(points, first, count, coordinates);
      PlaneCells cells;
      find_cells(size, pair, coordinates, cells);
      for (int lane = 0; lane < some; lane++) {
        const std::size_t point = first + lane;
        const Vec of_point =
            load_block(upstream + (point * PLANE_PAIRS + pair) * channels + channel, block.width);
        if (!is_zero(of_point)) add_point(block, corners(size, channels, cells, lane), of_point);
      }
    }
  });
}

}  // namespace ringlight::RINGLIGHT_ISA
