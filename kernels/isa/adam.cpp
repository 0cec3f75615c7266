#include "adam.hpp"

#include "parallel.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

constexpr std::size_t GRAIN = 16384;  // floats a piece: four arrays of 64 KB stay in L2

// Rows of a piece: a multiple of a cache line's floats, so that no two pieces of an aligned array write to one line.
// One row where rows are so wide that sixteen of them are more than a piece should be.
std::size_t rows_per_piece(const AdamColumn& column) {
  constexpr std::size_t LINE = 16;
  const std::size_t rows = GRAIN / (column.width * LINE) * LINE;
  return rows > 0 ? rows : 1;
}

std::size_t pieces_of(const AdamColumn& column) {
  const std::size_t rows = rows_per_piece(column);
  return (column.rows + rows - 1) / rows;
}

// What all elements of a parameter share.
struct Factors {
  float rate, correction, keep1, keep2, epsilon;

  explicit Factors(const AdamStep& step) : keep1(step.beta1), keep2(step.beta2), epsilon(step.epsilon) {
    const double number = static_cast<double>(step.step);
    rate = step.rate / static_cast<float>(1 - __builtin_pow(step.beta1, number));
    correction = static_cast<float>(1 / __builtin_sqrt(1 - __builtin_pow(step.beta2, number)));
  }
};

// The floats [begin, end) of one column.
void update(const AdamColumn& column, const Factors& factors, std::size_t begin, std::size_t end) {
  const auto [rate, correction, keep1, keep2, epsilon] = factors;
  float *value = column.value, *mean = column.mean, *square = column.square;
  const float* gradient = column.gradient;
#pragma GCC ivdep
  for (std::size_t i = begin; i < end; i++) {
    const float g = gradient[i];
    const float m = mean[i] + (1 - keep1) * (g - mean[i]);
    const float v = keep2 * square[i] + (1 - keep2) * g * g;
    mean[i] = m;
    square[i] = v;
    value[i] -= rate * m / (__builtin_sqrtf(v) * correction + epsilon);
  }
}

// Runs of drawn rows: with the table in Morton order what is seen lies together.
void update_drawn(const AdamColumn& column, const Factors& factors, const float* radii,
                  std::size_t begin, std::size_t end) {
  for (std::size_t row = begin; row < end;) {
    while (row < end && !(radii[2 * row] > 0)) row++;
    const std::size_t first = row;
    while (row < end && radii[2 * row] > 0) row++;
    if (row > first) update(column, factors, first * column.width, row * column.width);
  }
}

}  // namespace

void adam(const AdamColumn* columns, std::size_t count, const float* radii) {
  std::size_t pieces = 0;
  for (std::size_t i = 0; i < count; i++) pieces += pieces_of(columns[i]);
  parallel_for(pieces, [=](std::size_t piece) {
    const AdamColumn* column = columns;
    for (; piece >= pieces_of(*column); column++) piece -= pieces_of(*column);
    const std::size_t rows = rows_per_piece(*column), begin = piece * rows;
    const std::size_t end = begin + rows < column->rows ? begin + rows : column->rows;
    const Factors factors(column->step);
    if (radii) update_drawn(*column, factors, radii, begin, end);
    else update(*column, factors, begin * column->width, end * column->width);
  });
}

}  // namespace ringlight::RINGLIGHT_ISA
