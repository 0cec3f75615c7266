// Points in blocks: what the last cores make of a point, interpolated between its eight nodes, times the matrix of its
// block. Sums of eight rows are made anew on the way back: to keep them would take a kilobyte a point.
#include <cstring>

#include "dense/group_rows.isa.hpp"
#include "dense/shard_sums.isa.hpp"
#include "machine/scratch.isa.hpp"
#include "trains/bags.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

constexpr int SHARDS = 8;  // of blocks, whose gradients of rows are summed by themselves

struct Sizes {
  int outputs, width;
  std::size_t of_matrix, wide, narrow, either;

  explicit Sizes(const TrainBlocks& blocks)
      : outputs(static_cast<int>(blocks.outputs)),
        width(static_cast<int>(blocks.width)),
        of_matrix(blocks.outputs * blocks.width),
        wide(static_cast<std::size_t>(padded(width)) * GROUP),
        narrow(static_cast<std::size_t>(padded(outputs)) * GROUP),
        either(wide > narrow ? wide : narrow) {}
};

// Of up to GROUP points: `rows` [count][width], as `lanes` [width][GROUP], and `results` [outputs][GROUP]. Rows and
// blocks hold outputs, too.
struct Group {
  float *panels, *rows, *lanes, *results, *blocks;

  Group(const Sizes& sizes, float* memory) {
    panels = memory;
    rows = panels + panel_space(sizes);
    lanes = rows + sizes.either;
    blocks = lanes + sizes.wide;
    results = blocks + sizes.either;
  }
  static std::size_t size(const Sizes& sizes) {
    return panel_space(sizes) + 2 * sizes.either + sizes.wide + sizes.narrow;
  }

 private:
  static std::size_t panel_space(const Sizes& sizes) {
    const std::size_t one = panel_floats<Vec>(sizes.outputs, sizes.width);
    const std::size_t other = panel_floats<Vec>(sizes.width, sizes.outputs);
    return ((one > other ? one : other) + LANES - 1) / LANES * LANES;
  }
};

// Of parts by number.
void look_up(const TrainBlocks& blocks, const Sizes& sizes, const std::size_t* parts, int count, const Group& group) {
  for (int i = 0; i < count; i++)
    sum_rows(blocks.bags, parts[i], blocks.width, blocks.rows, group.rows + i * blocks.width);
  rows_to_lanes(group.rows, count, sizes.width, group.lanes);
}

// Calls body(parts, count) for the parts of a block that are `wanted`, up to GROUP at once, in their order.
template <class Wanted, class Body>
void each_group(const TrainBlocks& blocks, std::size_t block, const Wanted& wanted, const Body& body) {
  std::size_t parts[GROUP];
  int count = 0;
  const auto end = static_cast<std::size_t>(blocks.ends[block + 1]);
  for (auto part = static_cast<std::size_t>(blocks.ends[block]); part < end; part++) {
    if (!wanted(part)) continue;
    parts[count++] = part;
    if (count == GROUP) body(parts, count), count = 0;
  }
  if (count) body(parts, count);
}

template <class Float>
Float* of_point(const TrainBlocks& blocks, Float* points, std::size_t part) {
  return points + static_cast<std::size_t>(blocks.owners[part]) * blocks.outputs;
}

// Gradients of a block's matrix, by `group`, and of all rows, added to `to`, by `grad`.
void go_back(const TrainBlocks& blocks, const Sizes& sizes, std::size_t block, const float* gradient,
             const Group& group, const Group& grad, float* sums, float* grad_matrix, float* to) {
  const float* matrix = blocks.matrices + block * sizes.of_matrix;
  const Panels back = pack<Vec>(matrix, 1, sizes.width, nullptr, sizes.width, sizes.outputs, grad.panels);
  std::memset(sums, 0, weight_sums(sizes.outputs, sizes.width) * sizeof(float));
  const auto has_gradient = [&](std::size_t part) {
    const float* from = of_point(blocks, gradient, part);
    bool any = false;
    for (std::size_t i = 0; i < blocks.outputs; i++) any |= from[i] != 0.f;
    return any;
  };
  each_group(blocks, block, has_gradient, [&](const std::size_t* parts, int count) {
    look_up(blocks, sizes, parts, count, group);
    to_rows<Vec>(group.lanes, sizes.width, group.blocks);
    for (int i = 0; i < count; i++) {
      const float* from = of_point(blocks, gradient, parts[i]);
      std::memcpy(grad.rows + i * blocks.outputs, from, blocks.outputs * sizeof(float));
    }
    rows_to_lanes(grad.rows, count, sizes.outputs, grad.results);
    add_layer_gradient<Vec>({sums, nullptr, sizes.outputs, sizes.width}, grad.results, group.blocks);
    dense<Vec>(back, grad.results, grad.lanes);
    lanes_to_rows(grad.lanes, count, sizes.width, grad.blocks, grad.rows);
    for (int i = 0; i < count; i++) add_rows(blocks.bags, parts[i], blocks.width, grad.rows + i * blocks.width, to);
  });
  for (int o = 0; o < sizes.outputs; o++)
    std::memcpy(grad_matrix + static_cast<std::size_t>(o) * blocks.width,
                sums + static_cast<std::size_t>(o) * padded(sizes.width), blocks.width * sizeof(float));
}

}  // namespace

void train_products(const TrainBlocks& blocks, float* found) {
  const Sizes sizes(blocks);
  const auto count_of_parts = static_cast<std::size_t>(blocks.ends[blocks.count]);
  const Scratch parts(count_of_parts * blocks.outputs * sizeof(float));
  parallel_for(blocks.count, [&](std::size_t block) {
    const Scratch memory(Group::size(sizes) * sizeof(float));
    const Group group(sizes, memory.floats());
    const float* matrix = blocks.matrices + block * sizes.of_matrix;
    const Panels panels = pack<Vec>(matrix, sizes.width, 1, nullptr, sizes.outputs, sizes.width, group.panels);
    const auto all = [](std::size_t) { return true; };
    each_group(blocks, block, all, [&](const std::size_t* numbers, int count) {
      look_up(blocks, sizes, numbers, count, group);
      dense<Vec>(panels, group.lanes, group.results);
      lanes_to_rows(group.results, count, sizes.outputs, group.blocks,
                    parts.floats() + numbers[0] * blocks.outputs);
    });
  });
  // In the order of parts, by one thread: few numbers, and a point has up to eight.
  if (blocks.points) std::memset(found, 0, blocks.points * blocks.outputs * sizeof(float));
  for (std::size_t part = 0; part < count_of_parts; part++) {
    float* const to = of_point(blocks, found, part);
    for (std::size_t i = 0; i < blocks.outputs; i++) to[i] += parts.floats()[part * blocks.outputs + i];
  }
}

void train_products_gradient(const TrainBlocks& blocks, std::size_t row_count, const float* gradient,
                             float* grad_matrices, float* grad_rows) {
  const Sizes sizes(blocks);
  const std::size_t stride = row_count * blocks.width, parts = static_cast<std::size_t>(blocks.ends[blocks.count]);
  const Scratch shards(SHARDS * stride * sizeof(float));
  parallel_for(SHARDS, [&](std::size_t shard) {
    const std::size_t size = Group::size(sizes), of_sums = weight_sums(sizes.outputs, sizes.width);
    const Scratch memory((2 * size + of_sums) * sizeof(float));
    const Group group(sizes, memory.floats()), grad(sizes, memory.floats() + size);
    float *sums = memory.floats() + 2 * size, *to = shards.floats() + shard * stride;
    std::memset(to, 0, stride * sizeof(float));
    for (std::size_t block = 0; block < blocks.count; block++) {
      // A block belongs to the shard that its first part falls into.
      const auto begin = static_cast<std::size_t>(blocks.ends[block]);
      if (begin * SHARDS / (parts + 1) != shard) continue;
      go_back(blocks, sizes, block, gradient, group, grad, sums, grad_matrices + block * sizes.of_matrix, to);
    }
  });
  add_up_rows({shards.floats(), stride, SHARDS}, shards.floats(), blocks.width, row_count, blocks.width, grad_rows);
}

}  // namespace ringlight::RINGLIGHT_ISA
