// Stage 3: the depth-sorted Gaussians dealt out to the tiles they touch.
#pragma once
#include <cstdint>

#include "machine/buffer.hpp"
#include "raster/raster.hpp"

namespace ringlight {

class Binning {
 public:
  // Fills in tile_starts, tile_order, tile_count and entries of the view from `order`, the rows from near to far.
  // Needs placements, and pieces with their first_slot.
  void bin(View& view, const std::uint64_t* order, std::size_t drawn);

 private:
  Buffer<std::uint32_t> cursors_;  // [segments][tiles and a margin]
  Buffer<std::uint32_t> starts_, tile_order_;
  Buffer<std::uint64_t> entries_;
};

}  // namespace ringlight
