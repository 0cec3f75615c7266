// Stage 2: the drawn Gaussians in depth order.
#pragma once
#include <cstddef>
#include <cstdint>

#include "machine/buffer.hpp"
#include "raster/raster.hpp"

namespace ringlight {

class DepthSort {
 public:
  // Rows of the table from near to far, equal depths by row; valid until the next call. `drawn` is how many have a
  // depth key. Needs placements and pieces of the view.
  const std::uint64_t* sort(const View& view, std::size_t drawn);

 private:
  Buffer<std::uint64_t> pairs_, sorted_;  // key above, row below
  Buffer<std::uint32_t> counts_;          // [segments][digits]
};

// The row of the table in an element of the sorted list.
inline std::uint32_t row_of(std::uint64_t pair) { return static_cast<std::uint32_t>(pair); }

}  // namespace ringlight
