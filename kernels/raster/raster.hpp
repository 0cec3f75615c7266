// What the stages of the rasterizer hand to each other: plain records of pointers, so that files compiled for one
// instruction set share nothing with the rest but data. All memory belongs to the caller or to the Workspace.
//
//   project -> sort -> bin -> blend            forward:  table -> ellipses -> depth order -> tiles -> image
//   blend_gradient -> project_gradient         backward: image -> ellipses -> table
//
// An *entry* is one Gaussian in one tile. Every entry owns a *slot*, a row of sums that only its tile writes; the
// slots of one Gaussian lie side by side and are added up in order. Hence no atomics, and the same bits always.
#pragma once
#include <cstddef>
#include <cstdint>

#include "convention.hpp"
#include "raster/camera.hpp"
#include "raster/tile_shader.hpp"
#include "simd/dispatch.hpp"

namespace ringlight {

struct RasterSettings {
  float eps2d, near, max_alpha;
  bool antialiased, absgrad;
};

// The table as stored (before activation), N rows, and what gets blended.
struct Splats {
  std::size_t count;
  int channel_count;
  const float* means;           // [N 3] world units
  const float* log_scales;      // [N 3]
  const float* quats;           // [N 4] wxyz, any length
  const float* opacity_logits;  // [N]
  const float* opacity_factor;  // [N], or null for 1
  const float* channels;        // [N C]
  const float* background;      // [C]
};

// Colours that take the place of the channels. A row's colour is worked out when the blend first needs it.
struct LazyColors {
  // Writes the colours of at most LAZY_ROWS rows, [count LAZY_CHANNELS]. Threads call it at the same time, each with
  // scratch floats of its own. A row's bits depend neither on the thread nor on the other rows of the call.
  using Light = void (*)(const void* source, const std::int32_t* rows, int count, float* colors, float* scratch);
  Light light;
  const void* source;
  std::size_t scratch;  // floats
  std::size_t count;    // rows of the table
  float* kept;          // [count LAZY_CHANNELS]: the colours stay here for a backward pass; or null
};
inline constexpr int LAZY_ROWS = 64, LAZY_CHANNELS = 3;
inline constexpr int LAZY_GROUP = 32;  // rows that take as long as a single one
inline constexpr float NOT_LIT = -1;   // in a record: its colour is not worked out yet

struct Footprints {
  float* means2d;  // [N 2] pixels; 0 where not drawn
  float* radii;    // [N 2] half-extents in pixels, whole numbers; 0 where not drawn
};

struct Images {
  float* image;              // [C H W], or with a shader its colours, [3 H W]
  float* alpha;              // [H W]
  const TileShader* shader;  // or null
  float* blended;            // [C H W] with a shader: what was blended stays here for a backward pass; or null
  float* tiles;              // [T BLOCKS C + 1 LANES] in place of `blended`: block by block, alpha last; or null
  bool early_stop;           // blocks stop at EARLY_STOP: faster, not exact, no backward pass
};

// Where tiles were kept, `image` is Images::tiles, and `image_gradient` lies likewise, [T BLOCKS channels + 1 LANES].
// Beyond the first SHADED_CHANNELS, and of alpha, only those blocks have a gradient for which `drawn` is not 0; the
// others hold nothing there.
struct ImageGradients {
  const float* image;           // [C H W] what the forward pass returned
  const float* image_gradient;  // [C H W]
  const float* alpha_gradient;  // [H W], or null for 0 and with `drawn`
  const std::int32_t* drawn;    // [T BLOCKS] pixels of the block, bits; or null: planes are those of a picture
  int channels;                 // of `drawn` gradients
};

struct SplatGradients {
  float *means, *log_scales, *quats, *opacity_logits, *channels;  // shaped like the table
  float* opacity_factor;                                          // [N], or null
  float* means2d;                                                 // [N 2] 1/pixels
  float* absolute;                                                // [N 2], or null without absgrad
};

// Rows of the table that one task projects. Fixed, so that slots lie the same for any number of threads.
inline constexpr std::size_t ROWS_PER_PIECE = 2048;

// What one task found in its rows.
struct Piece {
  std::uint64_t first_slot;  // entries of all rows before this piece
  std::uint32_t entries, drawn;
  std::uint32_t nearest, farthest;  // range of the depth keys
  std::uint32_t broken;             // rows that hold a value which is not finite
};

// Depth keys are the bits of camera z, which order like z because z is positive.
inline constexpr std::uint32_t NOT_DRAWN = 0xffffffffu;

// Where a Gaussian goes. The tiles it touches are a rectangle in tile units and, for up to 31 tiles, one bit per tile
// in row-major order: `tiles` is EVERY_TILE for larger rectangles, carries LISTED for those that are not 2 x 2, and is
// otherwise the four bits of the 2 x 2 tiles at (x0, y0), by far the most frequent case.
struct Placement {
  std::uint8_t x0, y0, x1, y1;
  std::uint32_t tiles;
  std::uint32_t first_slot;  // counted from the first slot of its piece
  std::uint32_t depth_key;
};
inline constexpr std::uint32_t LISTED = 1u << 31, EVERY_TILE = ~0u;
inline constexpr unsigned LISTED_TILES = 31;
static_assert(convention::MAX_IMAGE_SIDE / convention::TILE <= 256, "a Placement has 8 bits for each bound");

// One record per Gaussian, one cache line. With d = pixel - centre, along = A dx + B dy, across = C dy:
// log2(alpha) = LOG2_OPACITY - along^2 - across^2, a Cholesky form that no rounding can make indefinite.
// The ellipse alpha = 1/255 spans x = SHEAR dy +- SPREAD sqrt(REACH2 - dy^2) in the row dy, |dy| <= sqrt(REACH2), and
// touches its leftmost and rightmost columns at dy = -TURN and dy = TURN.
enum RecordField {
  CENTER_X, CENTER_Y, ALONG_X, ALONG_Y, ACROSS_Y, LOG2_OPACITY,
  FIRST_CHANNELS,  // up to RECORD_CHANNELS channels
  SHEAR = 10, SPREAD, REACH2, TURN,
  LAZY_FIRST, LAZY_SECOND, LAZY_THIRD = 9,  // a lazy colour, once it is known
  RECORD = 16
};
inline constexpr int RECORD_CHANNELS = 4;

// One slot: sums over the pixels of a tile, with g = dL / d log(alpha) of each pixel and its moments in u = along and
// v = across. In these units, where the ellipse is a circle, needles lose no digits.
enum SlotField { SUM_G, SUM_GU, SUM_GV, SUM_GUU, SUM_GUV, SUM_GVV, SLOT_MOMENTS, ABSOLUTE_X = 6, ABSOLUTE_Y };

// Entries of a tile that are blended in one go: a list position fits one byte, the rows fit L1.
inline constexpr int CHUNK = 128;
inline constexpr int BLOCKS = 64;  // blocks of a tile, bits of a mask
inline constexpr int LANES = 16;   // pixels of a block
inline constexpr int TILE_PIXELS = BLOCKS * LANES;
inline constexpr int SHADED_CHANNELS = 3;  // what a shader leaves
inline constexpr float LOG2_MIN_ALPHA = -7.99435343685886f;  // log2(1 / 255): what is fainter is not drawn

struct View {
  Camera camera;
  RasterSettings settings;
  Splats splats;
  int gradient_channels;  // backward: the channels up to the last that has a gradient
  int tiles_x, tiles_y;

  // By row of the table, with room for a whole group of LANES at the end.
  float* records;         // [N RECORD]
  Placement* placements;  // [N]
  Piece* pieces;

  // By tile; entries of a tile front to back.
  int tile_count;
  std::uint32_t* tile_starts;  // [T + 1]
  std::uint32_t* tile_order;   // [T] longest first
  std::uint32_t* tile_used;    // [T] entries until every block was finished
  std::uint64_t* entries;      // row of the table, and the slot in the upper half
  std::uint64_t* block_masks;  // blocks of the tile that the entry touches and that was not finished yet
  float* final_transmittance;  // [T BLOCKS LANES]

  // By slot.
  float* slots;             // [slots slot_stride]
  std::uint8_t* slot_used;  // 1 where the slot was written

  // Null, or where lazy colours come from (lazy_colors.isa.hpp).
  const LazyColors* lazy;
  bool* lazy_broken;  // set where one is not finite

  // Memory of each worker.
  int workers;
  std::size_t scratch_stride;  // floats
  float* scratch;              // [workers scratch_stride]
};

// Pixels of all tiles, those beyond the image as well: a plane that lies tile by tile.
constexpr std::size_t tile_pixels(const Camera& camera) {
  constexpr std::size_t SIDE = convention::TILE;
  return (camera.width + SIDE - 1) / SIDE * ((camera.height + SIDE - 1) / SIDE) * TILE_PIXELS;
}

// Channels that the blending kernels are compiled for; narrower images are padded. Ten and the six moments fill a slot
// of one cache line; eleven are what deferred shading blends. Wider ones take the general kernel, which keeps the
// weights and adds up CHANNEL_GROUP channels at a time: more would not fit the registers.
inline constexpr int WIDE = 0, CHANNEL_GROUP = 8;
constexpr int kernel_channels(int channels) {
  constexpr int COMPILED[] = {1, 3, 4, 8, 10, 11};
  for (const int count : COMPILED)
    if (channels <= count) return count;
  return WIDE;
}
constexpr int round_up_lanes(int floats) { return (floats + LANES - 1) / LANES * LANES; }
constexpr int padded_channels(int channels) {
  if (kernel_channels(channels) != WIDE) return kernel_channels(channels);
  return (channels + CHANNEL_GROUP - 1) / CHANNEL_GROUP * CHANNEL_GROUP;
}
// Floats of one row of a chunk: the record, and channels that do not fit into it.
constexpr int row_stride(int channels) {
  return channels <= RECORD_CHANNELS ? RECORD : RECORD + round_up_lanes(channels);
}
constexpr int slot_moments(bool absgrad) { return absgrad ? ABSOLUTE_Y + 1 : SLOT_MOMENTS; }
constexpr int slot_stride(int channels, bool absgrad) {
  return round_up_lanes(slot_moments(absgrad) + padded_channels(channels));
}
// Floats that a block's pixels keep between chunks: transmittance, one more, and the channels.
constexpr int state_stride(int channels) { return (2 + padded_channels(channels)) * LANES; }

// Stages compiled once per instruction set.
#define RINGLIGHT_RASTER_STAGES(isa)                                    \
  namespace isa {                                                        \
  void project(const View& view, const Footprints& footprints);        \
  void blend(const View& view, const Images& images);                  \
  void blend_gradient(const View& view, const ImageGradients& from);   \
  void project_gradient(const View& view, const SplatGradients& to);   \
  }
RINGLIGHT_EVERY_ISA(RINGLIGHT_RASTER_STAGES)
#undef RINGLIGHT_RASTER_STAGES

}  // namespace ringlight
