#include "environment/shaded_rows.isa.hpp"

#include <cstring>

#include "machine/parallel.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

constexpr std::size_t ROWS_PER_PIECE = 512;
constexpr int DEPTH = 6;  // behind rgb and the normal

// What a group of Gaussians looks up.
struct ShadedGroup {
  LaneSurface surface;
  LanePlaces places;
  Looked smoother, rougher, around;
  Vec gloss;                                      // sigmoid of the roughness's logit
  Vec tint[LANES], light[3], share_of_light[3];   // three of the first are read
  LaneShares shares;
};

void look_up(const ShadedRows& rows, const LightLevels& levels, const SpecularTable& table, const float* maps,
             std::size_t first, int count, ShadedGroup& found) {
  const unsigned on = (1u << count) - 1;
  found.surface = lane_surface(rows, first, count);
  found.gloss = sigmoid(load_first(rows.roughness + first, count));
  const Vec roughness = fma(Vec(1.f - rows.smoothest), found.gloss, Vec(rows.smoothest));
  found.places = lane_places(levels, roughness);
  take_columns(rows.tints + 3 * first, 3, count, found.tint);
  found.shares = lane_shares(table, min(max(-found.surface.facing, Vec(0.f)), Vec(1.f)), roughness);
  look(found.places.smoother, maps, found.surface.reflected, on, found.smoother);
  look(found.places.rougher, maps, found.surface.reflected, on, found.rougher);
  if (rows.ambient) look(diffuse_faces(levels), maps, found.surface.normal, on, found.around);
  for (int c = 0; c < 3; c++) {
    found.tint[c] = sigmoid(found.tint[c]);
    const Vec sharp = seen(found.smoother, c);
    found.light[c] = fma(found.places.between, seen(found.rougher, c) - sharp, sharp);
    found.share_of_light[c] = fma(found.tint[c], found.shares.value[0], found.shares.value[1]);
  }
}

// What the gradients of a group's channels make of those of its materials, light and directions.
struct GroupGradient {
  Vec tint[3], roughness, cosine, smoother[3], rougher[3], around[3];
};

GroupGradient material_gradient(const ShadedRows& rows, const ShadedGroup& group, const Vec upstream[LANES]) {
  const Vec one(1.f), zero(0.f);
  GroupGradient of;
  Vec between = zero, values[2] = {zero, zero};
  for (int c = 0; c < 3; c++) {
    const Vec of_light = upstream[c] * group.share_of_light[c], by_share = upstream[c] * group.light[c];
    of.rougher[c] = of_light * group.places.between, of.smoother[c] = of_light - of.rougher[c];
    between = fma(of_light, seen(group.rougher, c) - seen(group.smoother, c), between);
    values[0] = fma(by_share, group.tint[c], values[0]), values[1] = values[1] + by_share;
    of.tint[c] = by_share * group.shares.value[0];
    if (rows.ambient) {
      of.tint[c] = fnma(upstream[c], seen(group.around, c), of.tint[c]);
      of.around[c] = upstream[c] * (one - group.tint[c]);
    }
    of.tint[c] = of.tint[c] * group.tint[c] * (one - group.tint[c]);
  }
  of.roughness = between * group.places.slope, of.cosine = zero;
  for (int k = 0; k < 2; k++) {
    of.roughness = fma(values[k], group.shares.by_roughness[k], of.roughness);
    of.cosine = fma(values[k], group.shares.by_cosine[k], of.cosine);
  }
  of.roughness = of.roughness * Vec(1.f - rows.smoothest) * group.gloss * (one - group.gloss);
  return of;
}

// Of the normal and the ray's direction, by way of what the group looks at; `texels` take what the maps get.
void direction_gradient(const ShadedRows& rows, const LightLevels& levels, const ShadedGroup& group,
                        const GroupGradient& of, unsigned on, float* texels, Vec of_normal[3], Vec of_direction[3]) {
  const LaneSurface& surface = group.surface;
  Vec of_reflected[3], more[3];
  look_gradient(group.smoother, of.smoother, of_reflected);
  look_gradient(group.rougher, of.rougher, more);
  for (int c = 0; c < 3; c++) of_reflected[c] = of_reflected[c] + more[c];
  texel_gradient(group.places.smoother, group.smoother, of.smoother, on, texels);
  texel_gradient(group.places.rougher, group.rougher, of.rougher, on, texels);
  if (rows.ambient) {
    look_gradient(group.around, of.around, more);
    for (int c = 0; c < 3; c++) of_normal[c] = of_normal[c] + more[c];
    texel_gradient(diffuse_faces(levels), group.around, of.around, on, texels);
  }
  // reflected = direction - 2 facing normal; the cosine is -facing, where that lies in [0, 1].
  const Vec twice = surface.facing + surface.facing;
  const Mask lit = both(ge(-surface.facing, Vec(0.f)), ge(surface.facing + Vec(1.f), Vec(0.f)));
  const Vec part = inner(of_reflected, surface.normal);
  const Vec of_facing = -(part + part) - keep(lit, of.cosine);
  for (int c = 0; c < 3; c++) {
    of_normal[c] = of_normal[c] + fnma(twice, of_reflected[c], of_facing * surface.direction[c]);
    of_direction[c] = fma(of_facing, surface.normal[c], of_reflected[c]);
  }
}

void group_gradient(const ShadedRows& rows, const LightLevels& levels, const SpecularTable& table, const float* maps,
                    std::size_t first, int count, const Vec upstream[LANES], const ShadedGradients& to,
                    float* texels) {
  ShadedGroup group;
  look_up(rows, levels, table, maps, first, count, group);
  const LaneSurface& surface = group.surface;
  const GroupGradient of = material_gradient(rows, group, upstream);
  Vec of_normal[3] = {upstream[NORMAL], upstream[NORMAL + 1], upstream[NORMAL + 2]}, of_direction[3];
  direction_gradient(rows, levels, group, of, (1u << count) - 1, texels, of_normal, of_direction);
  const Vec zero(0.f);
  Vec of_axis[3], columns[LANES];
  const auto put = [&](float* place, int width) {
    for (int i = width; i < LANES; i++) columns[i] = zero;
    put_columns(place + width * first, width, count, columns);
  };
  unit_gradient(of_normal, surface.normal, surface.shortening, surface.stretched, of_axis);
  unit_gradient(of_direction, surface.direction, surface.nearness, surface.has_distance, columns);
  for (int c = 0; c < 3; c++) columns[c] = fma(upstream[DEPTH], Vec(rows.camera.world_to_camera[8 + c]), columns[c]);
  put(to.means, 3);
  for (int c = 0; c < 3; c++) {
    columns[c] = keep(surface.outward, of_axis[c]);
    columns[3 + c] = select(surface.outward, zero, of_axis[c]);
  }
  put(to.residuals, 6);
  quaternion_gradient(surface.axes, of_axis, columns);
  put(to.quats, 4);
  for (int c = 0; c < 3; c++) columns[c] = of.tint[c];
  put(to.tints, 3);
  for (int c = 0; c < 3; c++) columns[c] = upstream[c];
  put(to.bases, 3);
  store_first(to.roughness + first, of.roughness, count);
}

// Of Gaussians that nobody saw.
void no_gradient(const ShadedGradients& to, std::size_t first, int count) {
  for (float* place : {to.means, to.bases, to.tints}) std::memset(place + 3 * first, 0, 3 * count * sizeof(float));
  std::memset(to.residuals + 6 * first, 0, 6 * count * sizeof(float));
  std::memset(to.quats + 4 * first, 0, 4 * count * sizeof(float));
  std::memset(to.roughness + first, 0, count * sizeof(float));
}

}  // namespace

void shaded_forward(const ShadedRows& rows, const LightLevels& levels, const SpecularTable& table, const float* maps,
                    float* channels) {
  parallel_ranges(rows.surface.count, ROWS_PER_PIECE, [&](std::size_t begin, std::size_t end) {
    for (std::size_t first = begin; first < end; first += LANES) {
      const int count = end - first < LANES ? static_cast<int>(end - first) : LANES;
      ShadedGroup group;
      look_up(rows, levels, table, maps, first, count, group);
      Vec columns[LANES], base[LANES];
      take_columns(rows.bases + 3 * first, 3, count, base);
      const float* m = rows.camera.world_to_camera + 8;
      columns[DEPTH] = Vec(m[3]);
      for (int c = 0; c < 3; c++) {
        columns[c] = fma(group.share_of_light[c], group.light[c], base[c]);
        if (rows.ambient) columns[c] = fma(Vec(1.f) - group.tint[c], seen(group.around, c), columns[c]);
        columns[NORMAL + c] = group.surface.normal[c];
        columns[DEPTH] = fma(Vec(m[c]), group.surface.means[c], columns[DEPTH]);
      }
      for (int i = rows.width; i < LANES; i++) columns[i] = Vec(0.f);
      put_columns(channels + rows.width * first, rows.width, count, columns);
    }
  });
}

void shaded_backward(const ShadedRows& rows, const LightLevels& levels, const SpecularTable& table, const float* maps,
                     const float* of_channels, const ShadedGradients& to, float* shards) {
  const std::size_t floats = levels.texels() * TEXEL;
  const std::size_t pieces = (rows.surface.count + ROWS_PER_PIECE - 1) / ROWS_PER_PIECE;
  parallel_for(TEXEL_SHARDS, [&](std::size_t shard) {
    float* const texels = shards + shard * floats;
    std::memset(texels, 0, floats * sizeof(float));
    // Pieces in turn, so that neighbours, which are seen together, are dealt to all.
    for (std::size_t piece = shard; piece < pieces; piece += TEXEL_SHARDS) {
      const std::size_t begin = piece * ROWS_PER_PIECE;
      const std::size_t end = begin + ROWS_PER_PIECE < rows.surface.count ? begin + ROWS_PER_PIECE : rows.surface.count;
      for (std::size_t first = begin; first < end; first += LANES) {
        const int count = end - first < LANES ? static_cast<int>(end - first) : LANES;
        Vec upstream[LANES], size(0.f);
        take_columns(of_channels + rows.width * first, rows.width, count, upstream);
        for (int i = rows.width; i < SURFACE_WIDTH; i++) upstream[i] = Vec(0.f);
        for (int i = 0; i < SURFACE_WIDTH; i++) size = size + abs(upstream[i]);
        // What is not a number is not skipped.
        if (bits(ge(Vec(0.f), size)) == (1u << LANES) - 1)
          no_gradient(to, first, count);
        else
          group_gradient(rows, levels, table, maps, first, count, upstream, to, texels);
      }
    }
  });
}

void add_shards(std::size_t floats, float* shards) {
  constexpr std::size_t FLOATS_PER_PIECE = 1 << 14;
  parallel_ranges(floats, FLOATS_PER_PIECE, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; i++) {
      float sum = shards[i];
      for (int s = 1; s < TEXEL_SHARDS; s++) sum += shards[s * floats + i];
      shards[i] = sum;
    }
  });
}

}  // namespace ringlight::RINGLIGHT_ISA
