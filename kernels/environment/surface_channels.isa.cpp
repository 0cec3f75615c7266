#include "environment/surface_channels.hpp"

#include "environment/shortest_axes.isa.hpp"
#include "machine/parallel.hpp"
#include "simd/row_columns.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

constexpr std::size_t ROWS_PER_PIECE = 2048;
constexpr int NORMAL = 3, STRENGTH = 6, WIDTH = 7;  // where a row's channels begin

template <class F>
void for_each_group(std::size_t rows, F&& body) {
  parallel_ranges(rows, ROWS_PER_PIECE, [&](std::size_t begin, std::size_t end) {
    for (std::size_t first = begin; first < end; first += LANES)
      body(first, end - first < LANES ? static_cast<int>(end - first) : LANES);
  });
}

}  // namespace

void surface_channels(const SurfaceRows& rows, const float* colors, float* channels) {
  for_each_group(rows.count, [&](std::size_t first, int count) {
    Vec columns[LANES], color[LANES];
    take_columns(colors + 3 * first, 3, count, color);
    for (int c = 0; c < 3; c++) columns[c] = color[c];
    shortest_axes(rows, first, count, columns + NORMAL);
    columns[STRENGTH] = sigmoid(load_first(rows.strengths + first, count));
    for (int i = WIDTH; i < LANES; i++) columns[i] = Vec(0.f);
    put_columns(channels + WIDTH * first, WIDTH, count, columns);
  });
}

void surface_gradient(const SurfaceRows& rows, const float* of_channels, const SurfaceGradients& to) {
  for_each_group(rows.count, [&](std::size_t first, int count) {
    Vec upstream[LANES], normal[3], columns[LANES];
    take_columns(of_channels + WIDTH * first, WIDTH, count, upstream);
    const auto put = [&](float* place, int width) {
      for (int i = width; i < LANES; i++) columns[i] = Vec(0.f);
      put_columns(place + width * first, width, count, columns);
    };
    for (int c = 0; c < 3; c++) columns[c] = upstream[c];
    put(to.colors, 3);
    quaternion_gradient(shortest_axes(rows, first, count, normal), upstream + NORMAL, columns);
    put(to.quats, 4);
    const Vec strength = sigmoid(load_first(rows.strengths + first, count));
    store_first(to.strengths + first, upstream[STRENGTH] * strength * (Vec(1.f) - strength), count);
  });
}

}  // namespace ringlight::RINGLIGHT_ISA
