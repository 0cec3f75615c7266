// The ring's product and its gradient, whatever its form.
#pragma once
#include "ring/product_diagonal.isa.hpp"
#include "ring/product_tiles.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

template <bool Keep>
static inline void multiply(Batch& batch, const RingShape& shape, const RingParameters<const float>& parameters,
                            const CellTables& tables) {
  const bool done = with_tiles<MatrixTerms>(
      shape, [&](auto rank) { multiply_tiles<MatrixTerms, decltype(rank)::VALUE, Keep>(batch, shape, tables); });
  if (done) return;
  if (shape.diagonal)
    multiply_diagonal(batch, shape, tables);
  else if (by_rows(shape))
    multiply_ring_rows(batch, shape, parameters);
  else
    multiply_ring(batch, shape, parameters);
}

}  // namespace ringlight::RINGLIGHT_ISA
