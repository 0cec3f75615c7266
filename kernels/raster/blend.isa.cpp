// Stage 4: front-to-back compositing (Porter & Duff 1984; Kerbl et al. 2023, eq. 3), tile by tile, in chunks of CHUNK
// entries. Within a chunk every block walks the list of the entries that touch it, its pixels in registers.
#include "raster/block_masks.isa.hpp"
#include "raster/block_state.isa.hpp"
#include "raster/lazy_colors.isa.hpp"
#include "raster/tile_planes.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

constexpr std::uint32_t PREFETCH = 24;  // entries ahead: about the latency of memory

template <int C>
RINGLIGHT_INLINE int width_of(const View& view) {
  return C == WIDE ? padded_channels(view.splats.channel_count) : C;
}
template <int C>
RINGLIGHT_INLINE int channel_offset() {
  return C != WIDE && C <= RECORD_CHANNELS ? FIRST_CHANNELS : RECORD;
}

// Entries [at, at + count) of a tile, copied together: their rows, and the blocks that each of them touches.
struct Chunk {
  std::uint32_t at;
  int count;
  float* rows;
  std::uint64_t* masks;  // [CHUNK]
};

// Fills in rows and masks of a chunk. The masks without finished blocks are also kept for the backward pass.
template <int C>
RINGLIGHT_INLINE void gather_chunk(const View& view, const Tile& tile, std::uint64_t alive, const Chunk& chunk) {
  const int channels = view.splats.channel_count;
  const int stride = row_stride(padded_channels(channels));
  const std::uint64_t* const entries = view.entries + chunk.at;
  const std::uint32_t last = tile.end - chunk.at - 1;
  for (int first = 0; first < chunk.count; first += LANES) {
    Vec fields[LANES];
    for (int i = 0; i < LANES; i++) {
      const std::uint32_t k = static_cast<std::uint32_t>(first + i < chunk.count ? first + i : chunk.count - 1);
      const std::size_t row = static_cast<std::uint32_t>(entries[k]);
      const std::uint32_t ahead = k + PREFETCH < last ? k + PREFETCH : last;
      __builtin_prefetch(view.records + std::size_t{static_cast<std::uint32_t>(entries[ahead])} * RECORD);
      fields[i] = load(view.records + row * RECORD);
      float* const to = chunk.rows + (first + i) * stride;
      store(to, fields[i]);
      if (C != WIDE && C <= RECORD_CHANNELS) continue;
      const std::size_t width = static_cast<std::size_t>(channels);
      const float* const from = view.splats.channels + row * width;
      const std::size_t next = static_cast<std::uint32_t>(entries[ahead]);
      prefetch_floats(view.splats.channels + next * width, channels);
      for (int c = 0; c < channels; c += LANES)
        store(to + RECORD + c, load_first(from + c, channels - c < LANES ? channels - c : LANES));
    }
    transpose(fields);
    find_blocks(fields, static_cast<float>(tile.left), static_cast<float>(tile.top), chunk.masks + first);
    for (int i = first; i < first + LANES && i < chunk.count; i++)
      view.block_masks[chunk.at + i] = chunk.masks[i] &= alive;
  }
  for (int i = chunk.count; i < CHUNK; i++) chunk.masks[i] = 0;
}

RINGLIGHT_INLINE Vec sample_alpha(const float* row, Vec x, Vec y, Vec strongest) {
  const Vec dx = x - Vec(row[CENTER_X]), dy = y - Vec(row[CENTER_Y]);
  const Vec along = fma(Vec(row[ALONG_Y]), dy, Vec(row[ALONG_X]) * dx), across = Vec(row[ACROSS_Y]) * dy;
  const Vec log2_alpha = fnma(across, across, fnma(along, along, Vec(row[LOG2_OPACITY])));
  return keep(ge(log2_alpha, Vec(LOG2_MIN_ALPHA)), min(exp2_fast(log2_alpha), strongest));
}

// Adds weighted channels to one block: `blended` listed rows, whose weights are known, for each group of channels.
RINGLIGHT_INLINE void add_channels(const RowList& list, int blended, std::size_t stride, const float* weights,
                                   int width, float* color) {
  for (int c = 0; c < width; c += CHANNEL_GROUP) {
    Vec sums[CHANNEL_GROUP];
#pragma GCC unroll 8
    for (int i = 0; i < CHANNEL_GROUP; i++) sums[i] = load(color + (c + i) * LANES);
    for (int k = 0; k < blended; k++) {
      const Vec weight = load(weights + k * LANES);
      const float* const channels = list.rows + list.numbers[k] * stride + RECORD + c;
#pragma GCC unroll 8
      for (int i = 0; i < CHANNEL_GROUP; i++) sums[i] = fma(weight, Vec(channels[i]), sums[i]);
    }
#pragma GCC unroll 8
    for (int i = 0; i < CHANNEL_GROUP; i++) store(color + (c + i) * LANES, sums[i]);
  }
}

constexpr int OPEN = -1;

// Blends the listed rows into the block with pixel centres (x, y). Returns the number of the row that finished the last
// of its pixels, OPEN if none did. `weights` has room for one Vec per row; only the general kernel uses it.
template <int C>
RINGLIGHT_INLINE int blend_block(const RowList& list, Vec x, Vec y, Vec strongest, int width, float* weights,
                                 float* state) {
  constexpr int KEPT = C == WIDE ? 1 : C;
  const std::size_t stride = static_cast<std::size_t>(row_stride(C == WIDE ? width : C));
  Vec running = load(state + RUNNING), final = load(state + FINAL), color[KEPT];
  if constexpr (C != WIDE)
#pragma GCC unroll 16
    for (int c = 0; c < C; c++) color[c] = load(state + COLOR + c * LANES);
  const Vec least(convention::MIN_TRANSMITTANCE);
  bool open = true;
  const float* row = list.rows + list.numbers[0] * stride;
  Vec alpha = sample_alpha(row, x, y, strongest);
  int k = 0;
  while (k < list.count) {
    // One row ahead: alpha takes long to compute, but does not wait for the rows in front.
    const float* const next_row = list.rows + list.numbers[k + 1] * stride;
    const Vec next_alpha = sample_alpha(next_row, x, y, strongest);
    const Vec behind = fnma(running, alpha, running);
    const Mask drawn = gt(behind, least);  // else the pixel is finished, before this Gaussian
    const Vec weight = keep(drawn, alpha * running);
    final = select(drawn, behind, final);
    running = behind;
    if constexpr (C == WIDE) {
      store(weights + k * LANES, weight);
    } else {
#pragma GCC unroll 16
      for (int c = 0; c < C; c++) color[c] = fma(weight, Vec(row[channel_offset<C>() + c]), color[c]);
    }
    k++;
    if (!any(drawn)) {
      open = false;
      break;
    }
    row = next_row;
    alpha = next_alpha;
  }
  store(state + RUNNING, running);
  store(state + FINAL, final);
  if constexpr (C == WIDE) add_channels(list, k, stride, weights, width, state + COLOR);
  else
#pragma GCC unroll 16
    for (int c = 0; c < C; c++) store(state + COLOR + c * LANES, color[c]);
  return open ? OPEN : list.numbers[k - 1];
}

template <int C>
RINGLIGHT_INLINE void blend_tile(const View& view, const Tile& tile, float* scratch, const Images& images) {
  if (tile.begin == tile.end) return write_background(view, tile, images);
  const int width = width_of<C>(view), floats = (2 + width) * LANES;
  const int written = images.shader ? SHADED_CHANNELS : view.splats.channel_count;
  prefetch_pixels(view, tile, images.alpha, 1);
  prefetch_pixels(view, tile, images.image, written);
  if (images.blended) prefetch_pixels(view, tile, images.blended, view.splats.channel_count);
  float* const rows = scratch;
  float* const weights = scratch + CHUNK * row_stride(C == WIDE ? width : C);
  float* const states = weights + CHUNK * LANES;
  float* const of_light = states + BLOCKS * floats;
  for (int block = 0; block < BLOCKS; block++) {
    float* const state = states + block * floats;
    store(state + RUNNING, Vec(1.f));
    store(state + FINAL, Vec(1.f));
    for (int c = 0; c < width; c++) store(state + COLOR + c * LANES, Vec(0.f));
  }
  alignas(64) std::uint64_t masks[CHUNK];
  std::uint8_t numbers[CHUNK + 64];  // list_set_bits may write past the end
  std::uint64_t alive = tile.inside;
  std::uint32_t at = tile.begin;
  while (at < tile.end && alive) {
    const int count = tile.end - at < CHUNK ? static_cast<int>(tile.end - at) : CHUNK;
    int finished_by = OPEN;  // the last row of the chunk that finished a block
    gather_chunk<C>(view, tile, alive, {at, count, rows, masks});
    if (C == LAZY_CHANNELS && view.lazy)
      add_lazy_colors(view, {view.entries + at, masks, count, tile.end - at, rows}, of_light);
    for (int i = 0; i < count; i += 64) transpose_bits(masks + i);  // now one word per block and 64 entries
    for (std::uint64_t left = alive; left; left &= left - 1) {
      const int block = __builtin_ctzll(left);
      int length = 0;
      for (int i = 0; i < count; i += 64) length += list_set_bits(masks[i + block], i, numbers + length);
      if (!length) continue;
      numbers[length] = numbers[0];
      const Vec x = load(CENTERS_X) + Vec(static_cast<float>(tile.left + 4 * (block % BLOCKS_PER_SIDE)));
      const Vec y = load(CENTERS_Y) + Vec(static_cast<float>(tile.top + 4 * (block / BLOCKS_PER_SIDE)));
      const RowList list{rows, numbers, length};
      float* const state = states + block * floats;
      const int last = blend_block<C>(list, x, y, Vec(view.settings.max_alpha), width, weights, state);
      if (last == OPEN) continue;
      alive &= ~(std::uint64_t{1} << block);
      finished_by = last > finished_by ? last : finished_by;
    }
    at += static_cast<std::uint32_t>(alive ? count : finished_by + 1);
    if (images.early_stop && count == CHUNK) alive = stop_early(alive, states, floats);
  }
  view.tile_used[tile.number] = at - tile.begin;
  write_tile(view, tile, states, floats, states + BLOCKS * floats, images);
}

template <int C>
void blend_all(const View& view, const Images& images) {
  for_each_tile(view, [&](const Tile& tile, float* scratch) { blend_tile<C>(view, tile, scratch, images); });
}

}  // namespace

void blend(const View& view, const Images& images) {
  switch (kernel_channels(view.splats.channel_count)) {
    case 1: return blend_all<1>(view, images);
    case 3: return blend_all<3>(view, images);
    case 4: return blend_all<4>(view, images);
    case 8: return blend_all<8>(view, images);
    case 10: return blend_all<10>(view, images);
    case 11: return blend_all<11>(view, images);
    default: return blend_all<WIDE>(view, images);
  }
}

}  // namespace ringlight::RINGLIGHT_ISA
