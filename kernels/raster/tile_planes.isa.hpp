// From blended blocks to the planes of a picture: finished, shaded where there is a shader, and written.
#pragma once
#include "raster/block_state.isa.hpp"
#include "raster/tile_pixels.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

// Lays what is behind the blended blocks under their channels.
RINGLIGHT_INLINE void finish_blocks(const View& view, const Tile& tile, float* states, int floats) {
  for (std::uint64_t left = tile.inside; left; left &= left - 1) {
    float* const state = states + __builtin_ctzll(left) * floats;
    const Vec transmittance = load(state + FINAL);
    store(state + BLOCK_ALPHA, Vec(1.f) - transmittance);
    for (int c = 0; c < view.splats.channel_count; c++) {
      float* const values = state + COLOR + c * LANES;
      store(values, fma(transmittance, Vec(view.splats.background[c]), load(values)));
    }
  }
}

// The first channels of what was blended to `image`, over what lies `behind` them: null where they are finished.
RINGLIGHT_INLINE void write_channels(const View& view, const Tile& tile, const float* states, int floats,
                                     int channels, const float* behind, float* image) {
  const std::size_t stride = static_cast<std::size_t>(view.camera.width);
  const std::size_t plane = stride * static_cast<std::size_t>(view.camera.height);
  for_each_quartet(view.camera, tile, [&](const Quartet& quartet) {
    const float* const first = states + quartet.first_block * floats;
    Vec transmittance[QUARTET], values[QUARTET];
    for (int k = 0; k < QUARTET; k++) transmittance[k] = load(first + k * floats + FINAL);
    for (int c = 0; c < channels; c++) {
      const Vec background(behind ? behind[c] : 0.f);
      for (int k = 0; k < QUARTET; k++)
        values[k] = fma(transmittance[k], background, load(first + k * floats + COLOR + c * LANES));
      store_quartet(image + static_cast<std::size_t>(c) * plane, stride, quartet, values);
    }
  });
}

RINGLIGHT_INLINE void write_alpha(const View& view, const Tile& tile, const float* states, int floats,
                                  float* alpha) {
  const std::size_t stride = static_cast<std::size_t>(view.camera.width);
  float* const kept = view.final_transmittance + static_cast<std::size_t>(tile.number) * BLOCKS * LANES;
  for_each_quartet(view.camera, tile, [&](const Quartet& quartet) {
    const float* const first = states + quartet.first_block * floats;
    Vec values[QUARTET];
    for (int k = 0; k < QUARTET; k++) {
      const Vec transmittance = load(first + k * floats + FINAL);
      store(kept + (quartet.first_block + k) * LANES, transmittance);
      values[k] = Vec(1.f) - transmittance;
    }
    store_quartet(alpha, stride, quartet, values);
  });
}

// Lanes of a block that are pixels of the image.
RINGLIGHT_INLINE Mask inside_image(const View& view, const Tile& tile, int block) {
  const int x = tile.left + convention::BLOCK * (block % BLOCKS_PER_SIDE);
  const int y = tile.top + convention::BLOCK * (block / BLOCKS_PER_SIDE);
  return both(lt(load(CENTERS_X), Vec(static_cast<float>(view.camera.width - x))),
              lt(load(CENTERS_Y), Vec(static_cast<float>(view.camera.height - y))));
}

// Finished blocks as they lie, and alpha, 0 outside the image. Where nothing is in front of a block, nobody asks for
// more of its channels than a shader leaves.
RINGLIGHT_INLINE void keep_tile(const View& view, const Tile& tile, const float* states, int floats, float* tiles) {
  const int channels = view.splats.channel_count;
  const std::size_t stride = static_cast<std::size_t>(channels + 1) * LANES;
  float* to = tiles + static_cast<std::size_t>(tile.number) * BLOCKS * stride;
  for (int block = 0; block < BLOCKS; block++, to += stride) {
    const float* const state = states + block * floats;
    const Vec alpha = keep(inside_image(view, tile, block), load(state + BLOCK_ALPHA));
    const int kept = any(gt(alpha, Vec(0.f))) ? channels : SHADED_CHANNELS;
    for (int c = 0; c < kept; c++) store(to + c * LANES, load(state + COLOR + c * LANES));
    store(to + channels * LANES, alpha);
  }
}

// What was blended, or what the shader makes of it.
RINGLIGHT_INLINE void write_tile(const View& view, const Tile& tile, float* states, int floats, float* scratch,
                                 const Images& images) {
  const int channels = view.splats.channel_count;
  write_alpha(view, tile, states, floats, images.alpha);
  const TileShader* const shader = images.shader;
  if (!shader) return write_channels(view, tile, states, floats, channels, view.splats.background, images.image);
  finish_blocks(view, tile, states, floats);
  if (images.blended) write_channels(view, tile, states, floats, channels, nullptr, images.blended);
  if (images.tiles) keep_tile(view, tile, states, floats, images.tiles);
  shader->shade(*shader, {tile.left, tile.top, tile.inside, states, static_cast<std::size_t>(floats)}, scratch);
  write_channels(view, tile, states, floats, SHADED_CHANNELS, nullptr, images.image);
}

// A tile in which there is nothing: what lies behind. Of kept tiles only alpha says so.
static inline void write_background(const View& view, const Tile& tile, const Images& images) {
  const std::size_t stride = static_cast<std::size_t>(view.camera.width);
  const std::size_t plane = stride * static_cast<std::size_t>(view.camera.height);
  const float* const behind = view.splats.background;
  float* const kept = view.final_transmittance + static_cast<std::size_t>(tile.number) * BLOCKS * LANES;
  for (int i = 0; i < BLOCKS * LANES; i += LANES) store(kept + i, Vec(1.f));
  const auto fill = [&](float* to, float value) {
    for_each_quartet(view.camera, tile, [&](const Quartet& quartet) {
      Vec values[QUARTET] = {value, value, value, value};
      store_quartet(to, stride, quartet, values);
    });
  };
  const auto fill_planes = [&](float* to, int count) {
    for (int c = 0; c < count; c++) fill(to + static_cast<std::size_t>(c) * plane, behind[c]);
  };
  fill(images.alpha, 0.f);
  fill_planes(images.image, images.shader ? SHADED_CHANNELS : view.splats.channel_count);
  if (images.blended) fill_planes(images.blended, view.splats.channel_count);
  if (images.tiles) {
    const std::size_t before = static_cast<std::size_t>(view.splats.channel_count) * LANES, stride = before + LANES;
    float* const first = images.tiles + static_cast<std::size_t>(tile.number) * BLOCKS * stride + before;
    for (int block = 0; block < BLOCKS; block++) store(first + block * stride, Vec(0.f));
  }
  view.tile_used[tile.number] = 0;
}

}  // namespace ringlight::RINGLIGHT_ISA
