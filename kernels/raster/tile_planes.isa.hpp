// From blended blocks to the planes of a picture: finished, shaded where there is a shader, and written.
#pragma once
#include "raster/block_state.isa.hpp"
#include "raster/tile_pixels.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

constexpr int SHADED_CHANNELS = 3;  // what a shader leaves

// Lays what is behind the blended blocks under their channels.
RINGLIGHT_INLINE void finish_blocks(const Frame& frame, const Tile& tile, float* states, int floats) {
  for (std::uint64_t left = tile.inside; left; left &= left - 1) {
    float* const state = states + __builtin_ctzll(left) * floats;
    const Vec transmittance = load(state + FINAL);
    store(state + BLOCK_ALPHA, Vec(1.f) - transmittance);
    for (int c = 0; c < frame.splats.channel_count; c++) {
      float* const values = state + COLOR + c * LANES;
      store(values, fma(transmittance, Vec(frame.splats.background[c]), load(values)));
    }
  }
}

// The first channels of what was blended to `image`, over what lies `behind` them: null where they are finished.
RINGLIGHT_INLINE void write_channels(const Frame& frame, const Tile& tile, const float* states, int floats,
                                     int channels, const float* behind, float* image) {
  const std::size_t stride = static_cast<std::size_t>(frame.camera.width);
  const std::size_t plane = stride * static_cast<std::size_t>(frame.camera.height);
  for_each_strip(frame, tile, [&](const Strip& strip) {
    const float* const first = states + strip.first_block * floats;
    Vec transmittance[STRIP], values[STRIP];
    for (int k = 0; k < STRIP; k++) transmittance[k] = load(first + k * floats + FINAL);
    for (int c = 0; c < channels; c++) {
      const Vec background(behind ? behind[c] : 0.f);
      for (int k = 0; k < STRIP; k++)
        values[k] = fma(transmittance[k], background, load(first + k * floats + COLOR + c * LANES));
      store_strip(image + static_cast<std::size_t>(c) * plane, stride, strip, values);
    }
  });
}

RINGLIGHT_INLINE void write_alpha(const Frame& frame, const Tile& tile, const float* states, int floats,
                                  float* alpha) {
  const std::size_t stride = static_cast<std::size_t>(frame.camera.width);
  float* const kept = frame.final_transmittance + static_cast<std::size_t>(tile.number) * BLOCKS * LANES;
  for_each_strip(frame, tile, [&](const Strip& strip) {
    const float* const first = states + strip.first_block * floats;
    Vec values[STRIP];
    for (int k = 0; k < STRIP; k++) {
      const Vec transmittance = load(first + k * floats + FINAL);
      store(kept + (strip.first_block + k) * LANES, transmittance);
      values[k] = Vec(1.f) - transmittance;
    }
    store_strip(alpha, stride, strip, values);
  });
}

// What was blended, or what the shader makes of it.
RINGLIGHT_INLINE void write_tile(const Frame& frame, const Tile& tile, float* states, int floats, float* scratch,
                                 const Images& images) {
  const int channels = frame.splats.channel_count;
  write_alpha(frame, tile, states, floats, images.alpha);
  const TileShader* const shader = images.shader;
  if (!shader) return write_channels(frame, tile, states, floats, channels, frame.splats.background, images.image);
  finish_blocks(frame, tile, states, floats);
  if (images.blended) write_channels(frame, tile, states, floats, channels, nullptr, images.blended);
  shader->shade(*shader, {tile.left, tile.top, tile.inside, states, static_cast<std::size_t>(floats)}, scratch);
  write_channels(frame, tile, states, floats, SHADED_CHANNELS, nullptr, images.image);
}

// A tile in which there is nothing: what lies behind.
static inline void write_background(const Frame& frame, const Tile& tile, const Images& images) {
  const std::size_t stride = static_cast<std::size_t>(frame.camera.width);
  const std::size_t plane = stride * static_cast<std::size_t>(frame.camera.height);
  const float* const behind = frame.splats.background;
  float* const kept = frame.final_transmittance + static_cast<std::size_t>(tile.number) * BLOCKS * LANES;
  for (int i = 0; i < BLOCKS * LANES; i += LANES) store(kept + i, Vec(1.f));
  const auto fill = [&](float* to, float value) {
    for_each_strip(frame, tile, [&](const Strip& strip) {
      Vec values[STRIP] = {value, value, value, value};
      store_strip(to, stride, strip, values);
    });
  };
  const auto fill_planes = [&](float* to, int count) {
    for (int c = 0; c < count; c++) fill(to + static_cast<std::size_t>(c) * plane, behind[c]);
  };
  fill(images.alpha, 0.f);
  fill_planes(images.image, images.shader ? SHADED_CHANNELS : frame.splats.channel_count);
  if (images.blended) fill_planes(images.blended, frame.splats.channel_count);
  frame.tile_used[tile.number] = 0;
}

}  // namespace ringlight::RINGLIGHT_ISA
