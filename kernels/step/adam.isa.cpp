#include "machine/parallel.hpp"
#include "step/adam_rows.isa.hpp"

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

// The floats [begin, end) of one column; returns how many were left as they were.
std::size_t update(const AdamColumn& column, const AdamFactors& factors, std::size_t begin, std::size_t end) {
  return adam_update(column.rows_memory().from(begin), column.gradient + begin, factors, end - begin);
}

// Runs of drawn rows: with the table in Morton order what is seen lies together.
std::size_t update_drawn(const AdamColumn& column, const AdamFactors& factors, const float* radii,
                         std::size_t begin, std::size_t end) {
  std::size_t kept = 0;
  for (std::size_t row = begin; row < end;) {
    while (row < end && !(radii[2 * row] > 0)) row++;
    const std::size_t first = row;
    while (row < end && radii[2 * row] > 0) row++;
    if (row > first) kept += update(column, factors, first * column.width, row * column.width);
  }
  return kept;
}

}  // namespace

std::size_t adam(const AdamColumn* columns, std::size_t count, const float* radii) {
  std::size_t pieces = 0, all_kept = 0;
  for (std::size_t i = 0; i < count; i++) pieces += pieces_of(columns[i]);
  std::size_t* const sum = &all_kept;
  parallel_for(pieces, [=](std::size_t piece) {
    const AdamColumn* column = columns;
    for (; piece >= pieces_of(*column); column++) piece -= pieces_of(*column);
    const std::size_t rows = rows_per_piece(*column), begin = piece * rows;
    const std::size_t end = begin + rows < column->rows ? begin + rows : column->rows;
    const AdamFactors factors(column->step);
    const std::size_t kept = radii ? update_drawn(*column, factors, radii, begin, end)
                                   : update(*column, factors, begin * column->width, end * column->width);
    if (kept) __atomic_fetch_add(sum, kept, __ATOMIC_RELAXED);
  });
  return all_kept;
}

}  // namespace ringlight::RINGLIGHT_ISA
