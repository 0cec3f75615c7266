// How deep each tile of a view can be seen into: what lies behind is neither sorted nor dealt out to the tile.
//
// The horizon is a guess, what an earlier picture of the same view found, but the picture does not depend on it: a tile
// is blended front to back until every block has ended. If that happens before its horizon, nothing behind would have
// been looked at. If not, the tile is blended once more, with all that it holds. Slots are numbered as without a
// horizon, hence image and gradients have the same bits.
#pragma once
#include <cstddef>
#include <cstdint>

#include "buffer.hpp"
#include "raster.hpp"

namespace ringlight {

class Horizon {
 public:
  // Marks what lies behind `depths` [T], camera z, in every tile that it touches as HIDDEN, and gives the frame the
  // limits by which bin() leaves out the rest; none where it would not pay. Returns how many of the `drawn` rows are
  // left to sort.
  std::size_t hide(Frame& frame, const float* depths, std::size_t drawn);

  // After the frame was blended: forgets what it found in those tiles that did not end before their horizon,
  // and moves the limits so that bin() deals out all of these tiles' rows and nothing to the others. Returns the number
  // of rows to sort for that, 0 if there is no such tile.
  std::size_t reopen(const Frame& frame);

  // Writes the depths at which the frame's tiles ended, a little generously; infinity where they did not.
  static void remember(const Frame& frame, float* depths);

 private:
  Buffer<std::uint32_t> limits_;  // [T and a margin] depth keys
};

}  // namespace ringlight
