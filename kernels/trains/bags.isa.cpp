// Sums of eight rows each, times their shares, and the way back.
#include "machine/parallel.hpp"
#include "trains/bags.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

constexpr std::size_t BAGS = 512;     // a piece
constexpr int COLUMNS = 4 * LANES;    // of a piece of the way back: 256 bytes of a row
constexpr std::size_t AHEAD = 2;      // bags whose rows are fetched before they are wanted

float sum_numbers(const float* numbers, const std::int32_t* index, const float* shares) {
  float sum = 0.f;
  for (int k = 0; k < TRAIN_CORNERS; k++) sum = __builtin_fmaf(shares[k], numbers[index[k]], sum);
  return sum;
}

// Adds what bag after bag leaves in the columns from `first` on, up to COLUMNS of them.
void scatter_columns(const Bags& bags, std::size_t count, std::size_t width, std::size_t first,
                     const float* gradient, float* rows) {
  const int columns = width - first < COLUMNS ? static_cast<int>(width - first) : COLUMNS;
  for (std::size_t bag = 0; bag < count; bag++) {
    const std::int32_t* index = bags.index + TRAIN_CORNERS * bag;
    const float* shares = bags.shares + TRAIN_CORNERS * bag;
    const float* from = gradient + bag * width + first;
    if (bag + AHEAD < count)
      for (int k = 0; k < TRAIN_CORNERS; k++)
        __builtin_prefetch(rows + static_cast<std::size_t>(index[AHEAD * TRAIN_CORNERS + k]) * width + first, 1);
    for (int column = 0; column < columns; column += LANES) {
      const int left = columns - column < LANES ? columns - column : LANES;
      const Vec value = load_first(from + column, left);
      for (int k = 0; k < TRAIN_CORNERS; k++) {
        if (shares[k] == 0.f) continue;
        float* to = rows + static_cast<std::size_t>(index[k]) * width + first + column;
        store_first(to, fma(Vec(shares[k]), value, load_first(to, left)), left);
      }
    }
  }
}

}  // namespace

void train_gather(const Bags& bags, std::size_t count, std::size_t width, const float* rows, float* found) {
  parallel_ranges(count, BAGS, [=](std::size_t begin, std::size_t end) {
    for (std::size_t bag = begin; bag < end; bag++) {
      if (width == 1)
        found[bag] = sum_numbers(rows, bags.index + TRAIN_CORNERS * bag, bags.shares + TRAIN_CORNERS * bag);
      else
        sum_rows(bags, bag, width, rows, found + bag * width);
    }
  });
}

// Columns are pieces, each of which goes through all bags in order: sums have one order. Single numbers are one piece:
// to find out what belongs to whom would take as long as to add it.
void train_scatter(const Bags& bags, std::size_t count, std::size_t width, const float* gradient, float* rows) {
  if (width == 1) {
    for (std::size_t bag = 0; bag < count; bag++) {
      if (gradient[bag] == 0.f) continue;  // most, where a share of the samples hands gradients on
      for (std::size_t i = TRAIN_CORNERS * bag; i < TRAIN_CORNERS * (bag + 1); i++)
        rows[bags.index[i]] += bags.shares[i] * gradient[bag];
    }
    return;
  }
  parallel_for((width + COLUMNS - 1) / COLUMNS, [=](std::size_t piece) {
    scatter_columns(bags, count, width, piece * COLUMNS, gradient, rows);
  });
}

}  // namespace ringlight::RINGLIGHT_ISA
