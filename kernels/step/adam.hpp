// Adam on many parameters at once. Kingma & Ba 2015, algorithm 1, with epsilon outside the bias correction, as torch.
#pragma once
#include <cstddef>

#include "simd/dispatch.hpp"

namespace ringlight {

struct AdamStep {
  float rate, beta1, beta2, epsilon;
  long step;  // 1 for the first update
};

// What an update changes.
struct AdamRows {
  float *value, *mean, *square;

  AdamRows from(std::size_t first) const { return {value + first, mean + first, square + first}; }
};

// One parameter: rows of `width` floats, of which `value`, `mean` and `square` change.
struct AdamColumn {
  float* value;
  const float* gradient;
  float *mean, *square;
  std::size_t rows, width;
  AdamStep step;

  AdamRows rows_memory() const { return {value, mean, square}; }
};

// All columns in one parallel loop. With `radii` ([rows 2]) only rows whose first radius is positive are updated: those
// that were drawn; the others keep value and moments. So does an element of which any would not be finite afterwards;
// returns how many those are.
#define RINGLIGHT_DECLARE_ADAM(isa)                                                    \
  namespace isa {                                                                      \
  std::size_t adam(const AdamColumn* columns, std::size_t count, const float* radii);  \
  }
RINGLIGHT_EVERY_ISA(RINGLIGHT_DECLARE_ADAM)
#undef RINGLIGHT_DECLARE_ADAM

}  // namespace ringlight
