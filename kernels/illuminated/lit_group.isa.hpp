// What the network is given of a group of Gaussians, one per lane.
#pragma once
#include "dense/lane_panels.isa.hpp"
#include "encoding/lane_codes.isa.hpp"
#include "illuminated/illuminated.hpp"
#include "planes/cells.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

// The rows of a group; lanes from `count` on repeat the last one.
struct LitLanes {
  int count;
  alignas(64) std::int32_t rows[GROUP];

  LitLanes(const LitGaussians& lit, std::size_t first)
      : count(lit.count - first < GROUP ? static_cast<int>(lit.count - first) : GROUP) {
    for (int i = 0; i < GROUP; i++) rows[i] = lit.rows[first + (i < count ? i : count - 1)];
  }
};

// Three columns of sixteen chosen rows.
static inline void gather_vectors(const float* rows, const std::int32_t* numbers, Vec columns[3]) {
  alignas(64) float lanes[3][LANES];
  for (int i = 0; i < LANES; i++)
    for (int c = 0; c < 3; c++) lanes[c][i] = rows[3 * static_cast<std::size_t>(numbers[i]) + c];
  for (int c = 0; c < 3; c++) columns[c] = load(lanes[c]);
}

static inline Vec gather_numbers(const float* column, const std::int32_t* numbers) {
  alignas(64) float lanes[LANES];
  for (int i = 0; i < LANES; i++) lanes[i] = column[numbers[i]];
  return load(lanes);
}

// Places in the field's coordinates, as far as it reaches.
static inline void field_points(const LitGaussians& lit, const Vec means[3], Vec points[3]) {
  for (int c = 0; c < 3; c++) {
    const Vec at = fma(means[c] - Vec(lit.low[c]), Vec(lit.scale[c]), Vec(-1.f));
    points[c] = min(max(at, Vec(-1.f)), Vec(1.f));
  }
}

// softplus, whose logarithm is of a number between 1 and 2.
RINGLIGHT_INLINE Vec roughness_of(const LitGaussians& lit, Vec stored) {
  const Vec x = stored - Vec(lit.roughness_shift);
  return fma(log2(Vec(1.f) + exp(-abs(x))), Vec(0.69314718f), max(x, Vec(0.f)));
}

// [3C][GROUP], of which sixteen lanes are written.
static inline void lane_products(const LightField& field, const Vec points[3], float* products) {
  const int channels = field.shape.channels;
  for (int pair = 0; pair < PLANE_PAIRS; pair++, products += channels * GROUP) {
    PlaneCells cells;
    find_cells(field.shape.pairs[pair], pair, points, cells);
    for (int channel = 0; channel < channels; channel += LANES) {
      const int width = block_width(channels, channel);
      Vec square[LANES];
      for (int lane = 0; lane < LANES; lane++) {
        const Corners at = corners(field.shape.pairs[pair], channels, cells, lane);
        const Vec plane = plane_value(at, field.grids.planes[pair] + channel, width);
        square[lane] = plane * line_value(at, field.grids.lines[pair] + channel, width);
      }
      transpose(square);
      for (int i = 0; i < width; i++) store(products + (channel + i) * GROUP, square[i]);
    }
  }
}

// Chosen rows [.. width] to lanes[width][GROUP].
static inline void gather_rows(const float* rows, int width, const std::int32_t* numbers, float* lanes) {
  for (int first = 0; first < width; first += LANES) {
    const int some = block_width(width, first);
    Vec square[LANES];
    for (int i = 0; i < LANES; i++)
      square[i] = load_block(rows + static_cast<std::size_t>(numbers[i]) * width + first, some);
    transpose(square);
    for (int i = 0; i < some; i++) store(lanes + (first + i) * GROUP, square[i]);
  }
}

// products[3C][GROUP], and of inputs[..][GROUP] what comes before and after the field's features, which are mixed of
// the products; tanh of the Gaussians' own is not taken yet. Points [GROUP 3] are written if they are wanted.
static inline void fill_group(const LightField& field, const LitGaussians& lit, const LitLanes& lanes, float* products,
                              float* inputs, float* points_to) {
  float* const view = inputs + 2 * field.features * GROUP;
  for (int half = 0; half < GROUP; half += LANES) {
    const std::int32_t* numbers = lanes.rows + half;
    Vec means[3], points[3], ray[3], code[CODE_BLOCKS * LANES];
    gather_vectors(lit.means, numbers, means);
    field_points(lit, means, points);
    if (points_to) store_columns(points_to + 3 * half, points[0], points[1], points[2]);
    lane_products(field, points, products + half);
    gather_rows(lit.features, field.features, numbers, inputs + half);
    for (int c = 0; c < 3; c++) ray[c] = means[c] - Vec(lit.position[c]);
    const Vec squared = fma(ray[0], ray[0], fma(ray[1], ray[1], ray[2] * ray[2]));
    const Vec inverse = Vec(1.f) / sqrt(max(squared, Vec(lit.smallest_length * lit.smallest_length)));
    for (int c = 0; c < 3; c++) store(view + c * GROUP + half, ray[c] = ray[c] * inverse);
    encode(ray, roughness_of(lit, gather_numbers(lit.roughness, numbers)), field.polynomials, code);
    for (int c = 0; c < CODE_WIDTH; c++) store(view + (3 + c) * GROUP + half, code[c]);
  }
}

}  // namespace ringlight::RINGLIGHT_ISA
