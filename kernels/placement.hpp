// The tiles of a Placement that is not 2 x 2.
#pragma once
#include <cstdint>

#include "raster.hpp"

namespace ringlight {

// Calls visit(tile number) for the tiles that it touches, in row-major order.
template <class Visit>
inline void for_listed_tiles(const Placement& place, int tiles_x, Visit&& visit) {
  std::uint32_t tiles = place.tiles;
  const bool every = tiles == EVERY_TILE;
  for (int y = place.y0; y <= place.y1; y++)
    for (int x = place.x0; x <= place.x1; x++, tiles >>= 1)
      if (every || (tiles & 1)) visit(y * tiles_x + x);
}

}  // namespace ringlight
