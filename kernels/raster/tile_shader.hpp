// What a shader is given of a picture tile by tile, as soon as it is blended: pixels that are still in the cache, and
// planes of channels that need not be written where nobody asks for gradients.
#pragma once
#include <cstddef>
#include <cstdint>

namespace ringlight {

// A block's numbers, sixteen pixels each: the alpha (while a tile is being blended the running transmittance), the
// final transmittance, and the channels (over their background once the tile is blended).
enum BlockState { BLOCK_ALPHA = 0, BLOCK_RUNNING = 0, BLOCK_FINAL = 16, BLOCK_CHANNELS = 32 };

struct BlendedTile {
  int left, top;         // pixels
  std::uint64_t inside;  // blocks that hold a pixel of the image; the others hold nothing
  float* states;         // by block
  std::size_t stride;    // floats of a block
};

// Turns the first three channels into colour, in place. `scratch` is the worker's own.
struct TileShader {
  void (*shade)(const TileShader& self, const BlendedTile& tile, float* scratch);
  std::size_t scratch;  // floats that it needs, whole cache lines
};

}  // namespace ringlight
