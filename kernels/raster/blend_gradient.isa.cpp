// Stage 5: the gradient of blending, front to back again. Entry by entry, each walks the blocks it touched while its
// sums stay in registers: one reduction and one slot written per entry.
//
// With w = alpha T and rest = sum of v . (what lies behind) + background, a pixel's g = dL / d log(alpha) is
// w (v . channels) - alpha / (1 - alpha) rest. `rest` starts as v . image - v_alpha T_final and loses w (v . channels)
// with every Gaussian, so the pass needs no back-to-front order and one scalar per pixel whatever the channels.
#include "raster/tile_pixels.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

constexpr std::uint32_t PREFETCH = 10;  // entries ahead

// State of a block: running transmittance, rest, then the image's gradient by channel.
enum State { RUNNING = 0, REST = LANES, UPSTREAM = 2 * LANES };

// What a worker keeps in its scratch memory.
struct Workplace {
  float* states;     // [BLOCKS][2 + width][LANES]
  float* channels;   // [width] of the current entry, padded with zeros
  float* weights;    // [BLOCKS][LANES] of the current entry, general kernel only
  int width;         // channels, padded
  alignas(64) float x[BLOCKS_PER_SIDE][LANES], y[BLOCKS_PER_SIDE][LANES];  // pixel centres by block column and row
};

RINGLIGHT_INLINE float* state_of(const Workplace& place, int block, int width) {
  return place.states + block * (2 + width) * LANES;
}

RINGLIGHT_INLINE void place_centers(const Tile& tile, Workplace& place) {
  for (int side = 0; side < BLOCKS_PER_SIDE; side++) {
    store(place.x[side], load(CENTERS_X) + Vec(static_cast<float>(tile.left + 4 * side)));
    store(place.y[side], load(CENTERS_Y) + Vec(static_cast<float>(tile.top + 4 * side)));
  }
}

RINGLIGHT_INLINE void open_tile(const View& view, const Tile& tile, const ImageGradients& from, Workplace& place) {
  const std::size_t stride = static_cast<std::size_t>(view.camera.width);
  const std::size_t plane = stride * static_cast<std::size_t>(view.camera.height);
  const float* const transmittance =
      view.final_transmittance + static_cast<std::size_t>(tile.number) * BLOCKS * LANES;
  place_centers(tile, place);
  const int floats = (2 + place.width) * LANES;
  for_each_quartet(view.camera, tile, [&](const Quartet& quartet) {
    float* const first = state_of(place, quartet.first_block, place.width);
    Vec rest[QUARTET], pixels[QUARTET], upstream[QUARTET];
    for (int k = 0; k < QUARTET; k++) rest[k] = Vec(0.f);
    if (from.alpha_gradient) {
      load_quartet(from.alpha_gradient, stride, quartet, upstream);
      for (int k = 0; k < QUARTET; k++)
        rest[k] = -(upstream[k] * load(transmittance + (quartet.first_block + k) * LANES));
    }
    for (int c = 0; c < view.gradient_channels; c++) {
      load_quartet(from.image_gradient + static_cast<std::size_t>(c) * plane, stride, quartet, upstream);
      load_quartet(from.image + static_cast<std::size_t>(c) * plane, stride, quartet, pixels);
      for (int k = 0; k < QUARTET; k++) {
        rest[k] = fma(upstream[k], pixels[k], rest[k]);
        store(first + k * floats + UPSTREAM + c * LANES, upstream[k]);
      }
    }
    for (int k = 0; k < QUARTET; k++) {
      float* const state = first + k * floats;
      for (int c = view.gradient_channels; c < place.width; c++) store(state + UPSTREAM + c * LANES, Vec(0.f));
      store(state + RUNNING, Vec(1.f));
      store(state + REST, rest[k]);
    }
  });
}

// The same from kept tiles, whose blocks lie as they are walked. Blocks that no gradient of the shader reached have
// only that of the colour.
RINGLIGHT_INLINE void open_kept_tile(const View& view, const Tile& tile, const ImageGradients& from,
                                     Workplace& place) {
  place_centers(tile, place);
  for (std::uint64_t left = tile.inside; left; left &= left - 1) {
    const int block = __builtin_ctzll(left), with_gradient = view.gradient_channels;
    const std::size_t number = static_cast<std::size_t>(tile.number) * BLOCKS + block;
    const float* const image = from.image + number * (view.splats.channel_count + 1) * LANES;
    const float* const gradient = from.image_gradient + number * (with_gradient + 1) * LANES;
    const bool drawn = from.drawn[number] != 0;
    float* const state = state_of(place, block, place.width);
    const int channels = drawn ? with_gradient : SHADED_CHANNELS;
    Vec rest(0.f);
    if (drawn) rest = -(load(gradient + with_gradient * LANES) * load(view.final_transmittance + number * LANES));
    for (int c = 0; c < channels; c++) {
      const Vec upstream = load(gradient + c * LANES);
      rest = fma(upstream, load(image + c * LANES), rest);
      store(state + UPSTREAM + c * LANES, upstream);
    }
    for (int c = channels; c < place.width; c++) store(state + UPSTREAM + c * LANES, Vec(0.f));
    store(state + RUNNING, Vec(1.f));
    store(state + REST, rest);
  }
}

template <int C, bool Absolute>
RINGLIGHT_INLINE void write_slot(float* slot, const Vec* sums) {
  constexpr int moments = slot_moments(Absolute);
  if constexpr (C == WIDE) {
    store_first(slot, lane_sums<moments>(sums), moments);
  } else {
    constexpr int terms = moments + C;
    store(slot, lane_sums<(terms < LANES ? terms : LANES)>(sums));
    if constexpr (terms > LANES) store(slot + LANES, lane_sums<terms - LANES>(sums + LANES));
  }
}

// The ellipse of an entry at the pixels of one block: all that does not wait for the entries in front.
struct Sample {
  Vec along, across, alpha;
};

struct Ellipse {
  Vec center_x, center_y, along_x, along_y, across_y, log2_opacity, strongest;
};

RINGLIGHT_INLINE Ellipse ellipse_of(const float* record, float max_alpha) {
  return {Vec(record[CENTER_X]), Vec(record[CENTER_Y]),     Vec(record[ALONG_X]), Vec(record[ALONG_Y]),
          Vec(record[ACROSS_Y]), Vec(record[LOG2_OPACITY]), Vec(max_alpha)};
}

RINGLIGHT_INLINE Sample sample(const Ellipse& e, const Workplace& place, int block) {
  const Vec dx = load(place.x[block % BLOCKS_PER_SIDE]) - e.center_x;
  const Vec dy = load(place.y[block / BLOCKS_PER_SIDE]) - e.center_y;
  const Vec along = fma(e.along_y, dy, e.along_x * dx), across = e.across_y * dy;
  const Vec log2_alpha = fnma(across, across, fnma(along, along, e.log2_opacity));
  return {along, across, keep(ge(log2_alpha, Vec(LOG2_MIN_ALPHA)), min(exp2_fast(log2_alpha), e.strongest))};
}

// v . channels for one block; adds weight v to the sums. One after the other for each channel: of ten that were loaded
// for the one and kept for the other, half would push sums out of the registers.
template <int C>
RINGLIGHT_INLINE Vec add_upstream(const float* upstream, const float* channels, Vec weight, Vec* sums) {
  Vec dot(0.f);
#pragma GCC unroll 16
  for (int c = 0; c < C; c++) {
    const Vec v = load(upstream + c * LANES);
    dot = c ? fma(v, Vec(channels[c]), dot) : v * Vec(channels[c]);
    sums[c] = fma(weight, v, sums[c]);
  }
  return dot;
}

// v . channels for one block of any width.
RINGLIGHT_INLINE Vec upstream_dot(const float* upstream, const float* channels, int width) {
  Vec even(0.f), odd(0.f);  // two sums, since each waits for itself
  for (int c = 0; c < width; c += CHANNEL_GROUP)
#pragma GCC unroll 8
    for (int i = c; i < c + CHANNEL_GROUP; i += 2) {
      even = fma(load(upstream + i * LANES), Vec(channels[i]), even);
      odd = fma(load(upstream + (i + 1) * LANES), Vec(channels[i + 1]), odd);
    }
  return even + odd;
}

// Moves one block past the entry and adds its pixels to the sums. Returns whether any pixel is still unfinished.
template <int C, bool Absolute>
RINGLIGHT_INLINE bool add_block(const Ellipse& e, const Sample& at, const float* channels, const Workplace& place,
                                int block, Vec* sums) {
  constexpr int moments = slot_moments(Absolute);
  const int width = C == WIDE ? place.width : C;
  float* const state = state_of(place, block, width);
  const Vec running = load(state + RUNNING), rest_before = load(state + REST), one(1.f);
  const Vec behind = fnma(running, at.alpha, running);
  const Mask drawn = gt(behind, Vec(convention::MIN_TRANSMITTANCE));
  const Vec weight = keep(drawn, at.alpha * running);
  store(state + RUNNING, behind);

  Vec dot;
  if constexpr (C == WIDE) {
    dot = upstream_dot(state + UPSTREAM, channels, width);
    store(place.weights + block * LANES, weight);
  } else {
    dot = add_upstream<C>(state + UPSTREAM, channels, weight, sums + moments);
  }
  const Vec own = weight * dot, rest = rest_before - own;
  store(state + REST, rest);
  // A clamped alpha does not move with the geometry; its channels still do.
  const Mask moves = both(drawn, lt(at.alpha, e.strongest));
  const Vec g = keep(moves, fnma(rest, at.alpha * reciprocal(one - at.alpha), own));

  const Vec g_along = g * at.along, g_across = g * at.across;
  sums[SUM_G] += g;
  sums[SUM_GU] += g_along;
  sums[SUM_GV] += g_across;
  sums[SUM_GUU] = fma(g_along, at.along, sums[SUM_GUU]);
  sums[SUM_GUV] = fma(g_along, at.across, sums[SUM_GUV]);
  sums[SUM_GVV] = fma(g_across, at.across, sums[SUM_GVV]);
  if constexpr (Absolute) {
    sums[ABSOLUTE_X] += abs(g_along);
    sums[ABSOLUTE_Y] += abs(fma(e.along_y, g_along, e.across_y * g_across));
  }
  return any(drawn);
}

// The gradients of the entry's channels, group by group, from the weights that its blocks left.
RINGLIGHT_INLINE void add_channels(const Workplace& place, std::uint64_t blocks, float* to) {
  for (int c = 0; c < place.width; c += CHANNEL_GROUP) {
    Vec sums[CHANNEL_GROUP];
#pragma GCC unroll 8
    for (int i = 0; i < CHANNEL_GROUP; i++) sums[i] = Vec(0.f);
    for (std::uint64_t left = blocks; left; left &= left - 1) {
      const int block = __builtin_ctzll(left);
      const Vec weight = load(place.weights + block * LANES);
      const float* const upstream = state_of(place, block, place.width) + UPSTREAM + c * LANES;
#pragma GCC unroll 8
      for (int i = 0; i < CHANNEL_GROUP; i++) sums[i] = fma(weight, load(upstream + i * LANES), sums[i]);
    }
    store_first(to + c, lane_sums<CHANNEL_GROUP>(sums), CHANNEL_GROUP);
  }
}

// Adds up one entry over the blocks in `mask`. Returns the blocks whose pixels are all finished.
template <int C, bool Absolute>
RINGLIGHT_INLINE std::uint64_t walk_entry(const Ellipse& e, const float* channels, std::uint64_t mask,
                                          const Workplace& place, float* slot) {
  constexpr int terms = slot_moments(Absolute) + (C == WIDE ? 0 : C);
  [[maybe_unused]] const std::uint64_t visited = mask;
  Vec sums[terms];
#pragma GCC unroll 32
  for (int i = 0; i < terms; i++) sums[i] = Vec(0.f);
  std::uint64_t finished = 0;
  int block = __builtin_ctzll(mask);
  Sample now = sample(e, place, block);
  // One block ahead: the long chain of a sample overlaps the other long chain, that of the block before.
  while (mask &= mask - 1) {
    const int next_block = __builtin_ctzll(mask);
    const Sample next = sample(e, place, next_block);
    if (!add_block<C, Absolute>(e, now, channels, place, block, sums)) [[unlikely]]
      finished |= std::uint64_t{1} << block;
    block = next_block;
    now = next;
  }
  if (!add_block<C, Absolute>(e, now, channels, place, block, sums)) [[unlikely]]
    finished |= std::uint64_t{1} << block;
  write_slot<C, Absolute>(slot, sums);
  if constexpr (C == WIDE) add_channels(place, visited, slot + slot_moments(Absolute));
  return finished;
}

// The channels of a row where the kernel can read all that it is compiled for.
template <int C>
RINGLIGHT_INLINE const float* channels_of(const View& view, const float* record, std::size_t row,
                                          const Workplace& place) {
  if constexpr (C != WIDE && C <= RECORD_CHANNELS) return record + FIRST_CHANNELS;
  const int channels = view.splats.channel_count;
  const float* const from = view.splats.channels + row * static_cast<std::size_t>(channels);
  if (place.width <= channels) return from;
  for (int c = 0; c < channels; c += LANES)
    store(place.channels + c, load_first(from + c, channels - c < LANES ? channels - c : LANES));
  return place.channels;
}

template <int C, bool Absolute>
RINGLIGHT_INLINE void walk_tile(const View& view, const Tile& tile, const Tile* next, const ImageGradients& from,
                                Workplace& place) {
  const std::uint32_t end = tile.begin + view.tile_used[tile.number];
  if (end == tile.begin) return;
  if (from.drawn) open_kept_tile(view, tile, from, place);
  else open_tile(view, tile, from, place);
  if (next && !from.drawn) {
    prefetch_pixels(view, *next, from.image_gradient, view.gradient_channels);
    prefetch_pixels(view, *next, from.image, view.gradient_channels);
  }
  const std::size_t stride =
      static_cast<std::size_t>(slot_stride(C == WIDE ? view.gradient_channels : C, Absolute));
  std::uint64_t alive = tile.inside;
  for (std::uint32_t at = tile.begin; at < end; at++) {
    const std::uint64_t mask = view.block_masks[at] & alive;
    if (!mask) continue;
    const std::uint64_t entry = view.entries[at], ahead = view.entries[at + PREFETCH < end ? at + PREFETCH : end - 1];
    __builtin_prefetch(view.records + std::size_t{static_cast<std::uint32_t>(ahead)} * RECORD);
    __builtin_prefetch(view.slots + (ahead >> 32) * stride, 1);
    __builtin_prefetch(view.slot_used + (ahead >> 32), 1);
    if (C == WIDE || C > RECORD_CHANNELS)
      prefetch_floats(view.splats.channels + static_cast<std::uint32_t>(ahead) *
                          static_cast<std::size_t>(view.splats.channel_count), view.splats.channel_count);
    const std::size_t row = static_cast<std::uint32_t>(entry), slot = entry >> 32;
    const float* const record = view.records + row * RECORD;
    const float* const channels = channels_of<C>(view, record, row, place);
    view.slot_used[slot] = 1;
    const Ellipse ellipse = ellipse_of(record, view.settings.max_alpha);
    alive &= ~walk_entry<C, Absolute>(ellipse, channels, mask, place, view.slots + slot * stride);
  }
}

template <int C, bool Absolute>
void walk_all(const View& view, const ImageGradients& from) {
  for_each_tile_ahead(view, [&](const Tile& tile, const Tile* next, float* scratch) {
    Workplace place;
    place.width = C == WIDE ? padded_channels(view.gradient_channels) : C;
    place.states = scratch;
    place.weights = scratch + BLOCKS * (2 + place.width) * LANES;
    place.channels = place.weights + BLOCKS * LANES;
    walk_tile<C, Absolute>(view, tile, next, from, place);
  });
}

template <int C>
void walk_all(const View& view, const ImageGradients& from) {
  view.settings.absgrad ? walk_all<C, true>(view, from) : walk_all<C, false>(view, from);
}

}  // namespace

void blend_gradient(const View& view, const ImageGradients& from) {
  switch (kernel_channels(view.gradient_channels)) {
    case 1: return walk_all<1>(view, from);
    case 3: return walk_all<3>(view, from);
    case 4: return walk_all<4>(view, from);
    case 8: return walk_all<8>(view, from);
    case 10: return walk_all<10>(view, from);
    case 11: return walk_all<11>(view, from);
    default: return walk_all<WIDE>(view, from);
  }
}

}  // namespace ringlight::RINGLIGHT_ISA
