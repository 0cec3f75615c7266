#include "reflection/mirror_channels.hpp"

#include <cstring>

#include "machine/parallel.hpp"
#include "machine/scratch.isa.hpp"
#include "simd/row_columns.isa.hpp"
#include "step/sh_block.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

constexpr std::size_t ROWS_PER_PIECE = 2048;
constexpr int NORMAL = 3, LATENTS = 6;  // where a row's channels begin; the depth is the last

// What of dL/d(colour) passes: nothing where the colour was clamped at black, which is -0 then, nor where it is not a
// number.
Vec unclamped(Vec color, Vec upstream) {
  alignas(64) float colors[LANES], gradient[LANES];
  store(colors, color);
  store(gradient, upstream);
  for (int i = 0; i < LANES; i++)
    gradient[i] = colors[i] >= 0 && !__builtin_signbit(colors[i]) ? gradient[i] : 0.0f;
  return load(gradient);
}

// Turns the gradients of sixteen colours, `by_sum`, into what passes, and adds that of the means by their harmonics.
void vary(const VaryingColors& varying, std::size_t first, int count, Vec* by_sum, Vec* by_means) {
  Vec columns[LANES];
  take_columns(varying.colors + 3 * first, 3, count, columns);
  const float* const slopes = varying.slopes + first * SH_SLOPES;
  for (int c = 0; c < 3; c++) {
    by_sum[c] = unclamped(columns[c], by_sum[c]);
    for (int axis = 0; axis < 3; axis++)
      by_means[axis] = fma(load(slopes + (3 * c + axis) * LANES), by_sum[c], by_means[axis]);
  }
  for (int i = 0; i < LANES; i++) columns[i] = i < 3 ? Vec(convention::C0) * by_sum[i] : Vec(0.f);
  put_columns(varying.by_constant + 3 * first, 3, count, columns);
}

Vec dot(const Vec* a, const Vec* b) { return fma(a[0], b[0], fma(a[1], b[1], a[2] * b[2])); }

// The unit normals, and what the stored ones are multiplied with: negative where they are turned round.
struct Normals {
  Vec unit[3], factor;
  Mask has_length;
};

Normals facing(const MirrorScene& scene, const Vec* normals, const Vec* means) {
  const Vec squared = dot(normals, normals), least(scene.smallest_length * scene.smallest_length);
  Vec towards[3];
  for (int c = 0; c < 3; c++) towards[c] = Vec(scene.camera.position[c]) - means[c];
  Normals result;
  result.has_length = gt(squared, least);
  const Vec inverse = Vec(1.f) / sqrt(max(squared, least));
  const Vec distance = sqrt(max(dot(towards, towards), least));
  const Mask stays = ge(dot(normals, towards) * inverse, Vec(scene.flip_below) * distance);
  result.factor = select(stays, inverse, -inverse);
  for (int c = 0; c < 3; c++) result.unit[c] = normals[c] * result.factor;
  return result;
}

}  // namespace

void mirror_channels(const MirrorScene& scene, const MirrorColumns<const float>& from, float* channels) {
  const int width = LATENTS + scene.latents + 1;
  const float* const depth = scene.camera.world_to_camera + 8;  // depth = depth[0..2] . mean + depth[3]
  parallel_ranges(scene.count, ROWS_PER_PIECE, [&](std::size_t begin, std::size_t end) {
    for (std::size_t first = begin; first < end; first += LANES) {
      const int count = end - first < LANES ? static_cast<int>(end - first) : LANES;
      Vec means[LANES], columns[LANES], normals[LANES], latents[LANES];
      take_columns(from.means + 3 * first, 3, count, means);
      take_columns((scene.varying.colors ? scene.varying.colors : from.base) + 3 * first, 3, count, columns);
      take_columns(from.normals + 3 * first, 3, count, normals);
      if (scene.latents) take_columns(from.latents + scene.latents * first, scene.latents, count, latents);
      const Normals turned = facing(scene, normals, means);
      for (int c = 0; c < 3; c++) {
        if (!scene.varying.colors) columns[c] = sigmoid(columns[c]);
        columns[NORMAL + c] = turned.unit[c];
      }
      for (int i = 0; i < scene.latents; i++) columns[LATENTS + i] = latents[i];
      const Vec row[3] = {Vec(depth[0]), Vec(depth[1]), Vec(depth[2])};
      columns[width - 1] = dot(row, means) + Vec(depth[3]);
      for (int i = width; i < LANES; i++) columns[i] = Vec(0.f);
      put_columns(channels + width * first, width, count, columns);
    }
  });
}

bool mirror_gradient(const MirrorScene& scene, const MirrorColumns<const float>& from, const float* of_channels,
                     const MirrorColumns<float>& to) {
  const int width = LATENTS + scene.latents + 1;
  const float* const depth = scene.camera.world_to_camera + 8;  // depth = depth[0..2] . mean + depth[3]
  const std::size_t pieces = (scene.count + ROWS_PER_PIECE - 1) / ROWS_PER_PIECE;
  const Scratch flags(pieces + 1);
  auto* const depth_gradients = static_cast<unsigned char*>(flags.data());
  parallel_ranges(scene.count, ROWS_PER_PIECE, [&](std::size_t begin, std::size_t end) {
    bool has_gradient = false;
    for (std::size_t first = begin; first < end; first += LANES) {
      const int count = end - first < LANES ? static_cast<int>(end - first) : LANES;
      Vec means[LANES], base[LANES], normals[LANES], upstream[LANES], columns[LANES], by_means[3];
      take_columns(from.means + 3 * first, 3, count, means);
      take_columns(from.base + 3 * first, 3, count, base);
      take_columns(from.normals + 3 * first, 3, count, normals);
      take_columns(of_channels + width * first, width, count, upstream);
      const auto put = [&](float* rows, int columns_of_row) {
        for (int i = columns_of_row; i < LANES; i++) columns[i] = Vec(0.f);
        put_columns(rows + columns_of_row * first, columns_of_row, count, columns);
      };
      const Vec of_depth = upstream[width - 1];
      has_gradient = has_gradient || any(gt(abs(of_depth), Vec(0.f))) || !(sum(of_depth) == 0);  // NaN counts too
      for (int c = 0; c < 3; c++) by_means[c] = of_depth * Vec(depth[c]);
      if (scene.varying.colors) vary(scene.varying, first, count, upstream, by_means);
      for (int c = 0; c < 3; c++) {
        const Vec color = sigmoid(base[c]);
        columns[c] = upstream[c] * color * (Vec(1.f) - color);
      }
      put(to.base, 3);
      const Normals turned = facing(scene, normals, means);
      const Vec radial = keep(turned.has_length, dot(upstream + NORMAL, turned.unit));
      for (int c = 0; c < 3; c++) columns[c] = turned.factor * fnma(radial, turned.unit[c], upstream[NORMAL + c]);
      put(to.normals, 3);
      for (int i = 0; i < scene.latents; i++) columns[i] = upstream[LATENTS + i];
      if (scene.latents) put(to.latents, scene.latents);
      for (int c = 0; c < 3; c++) columns[c] = by_means[c];
      put(to.means, 3);
    }
    depth_gradients[begin / ROWS_PER_PIECE] = has_gradient;
  });
  return scene.varying.colors || std::memchr(depth_gradients, 1, pieces) != nullptr;
}

}  // namespace ringlight::RINGLIGHT_ISA
