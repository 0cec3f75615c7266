// Deferred shading of a tile as soon as it is blended, block by block: the same as reflection_forward, while the planes
// are in the cache; in pictures that get no gradients with the widest layer in bytes, where the instruction set
// multiplies them.
#include "dense/lane_bytes.isa.hpp"
#include "raster/tiles.isa.hpp"
#include "reflection/batch.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

struct PictureTables : ReflectionTables {
  BytePanels middle;  // from the first hidden layer to the second, if there are two
};

PictureTables prepare_picture(const ReflectionShading& shading, Arena& arena) {
  const ReflectionShape& shape = shading.shape;
  const auto& middle = shading.parameters.mlp[1];
  PictureTables tables{prepare(shape, shading.parameters, arena), {}};
  if (are_bytes<FastBytes> && shape.layers == 3 && !shading.exact)
    tables.middle = pack_bytes(middle.weight, middle.bias, shape.hidden, shape.hidden, arena);
  return tables;
}

template <class Bytes>
void run_network(const ReflectionShape& shape, const PictureTables& tables, ReflectionBatch& batch) {
  if constexpr (are_bytes<Bytes>) {
    if (shape.layers < 3) return run_network_once(shape, tables, batch);
    const float* terms = feature_terms<LayerTerms>(batch.inputs, network_inputs(shape), batch.terms);
    dense<LayerTerms, Result::RECTIFIED>(tables.layers[0], terms, batch.hidden[0]);
    auto* const words = reinterpret_cast<std::int32_t*>(batch.terms);
    alignas(64) float scales[GROUP];
    to_bytes<Bytes>(batch.hidden[0], shape.hidden, words, scales);
    dense_bytes<Bytes>(tables.middle, words, scales, batch.hidden[1]);
    dense<LayerTerms>(tables.layers[2], batch.hidden[1], batch.added);
  } else {
    run_network_once(shape, tables, batch);
  }
}

// A block's sixteen pixels are planes of sixteen numbers.
ReflectionBuffers<const float> planes_of(const ReflectionShape& shape, const float* state) {
  const float *rgb = state + BLOCK_CHANNELS, *normal = rgb + 3 * LANES, *latents = normal + 3 * LANES;
  return {rgb, normal, latents, latents + shape.latents * LANES, state + BLOCK_ALPHA, LANES};
}

PixelLanes pixels_of(const ReflectionShape& shape, const BlendedTile& tile, int block) {
  const int column = block % BLOCKS_PER_SIDE, row = block / BLOCKS_PER_SIDE;
  return {load(CENTERS_X) + Vec(static_cast<float>(tile.left + convention::BLOCK * column)),
          load(CENTERS_Y) + Vec(static_cast<float>(tile.top + convention::BLOCK * row)),
          planes_of(shape, tile.states + block * tile.stride)};
}

// The colour of the pixels that are opaque enough, in place of their rgb.
void shade_block(float faintest, const float* added, float* state) {
  const Vec alpha = load(state + BLOCK_ALPHA);
  for (int c = 0; c < 3; c++) {
    float* const rgb = state + BLOCK_CHANNELS + c * LANES;
    const Vec base = load(rgb);
    store(rgb, select(gt(alpha, Vec(faintest)), fma(alpha, load(added + c * GROUP), base), base));
  }
}

void shade_tile(const TileShader& self, const BlendedTile& tile, float* scratch) {
  const auto& shading = static_cast<const ReflectionShading&>(self);
  const auto& tables = *static_cast<const PictureTables*>(shading.tables);
  ReflectionBatch batch;
  Arena arena{scratch};
  lay_out(batch, shading.shape, false, arena);
  int blocks[HALVES], count = 0;
  const MatrixUnit unit;
  const auto shade_group = [&] {
    for (int half = 0; half < HALVES; half++) {
      batch.pixels[half] = pixels_of(shading.shape, tile, blocks[half < count ? half : 0]);
      look<false>({shading.shape, shading.parameters, shading.view, tables}, batch, half);
    }
    if (shading.exact) run_network_once(shading.shape, tables, batch);
    else run_network<FastBytes>(shading.shape, tables, batch);
    for (int half = 0; half < count; half++)
      shade_block(shading.view.faintest, batch.added + half * LANES, tile.states + blocks[half] * tile.stride);
    count = 0;
  };
  for (std::uint64_t left = tile.inside; left; left &= left - 1) {
    const int block = __builtin_ctzll(left);
    const Vec alpha = load(tile.states + block * tile.stride + BLOCK_ALPHA);
    if (!any(gt(alpha, Vec(shading.view.faintest)))) continue;
    blocks[count++] = block;
    if (count == HALVES) shade_group();
  }
  if (count) shade_group();
}

// The tables' record comes first, then what it points to.
constexpr std::size_t RECORD_FLOATS = (sizeof(PictureTables) / sizeof(float) + LANES - 1) / LANES * LANES;

}  // namespace

std::size_t reflection_room(const ReflectionShading& shading) {
  Arena counter{nullptr};
  prepare_picture(shading, counter);
  return (RECORD_FLOATS + counter.used) * sizeof(float);
}

void reflection_prepare(ReflectionShading& shading, void* room) {
  Arena arena{static_cast<float*>(room) + RECORD_FLOATS};
  auto* const tables = static_cast<PictureTables*>(room);
  *tables = prepare_picture(shading, arena);
  shading.tables = tables;
  ReflectionBatch batch;
  Arena counter{nullptr};
  lay_out(batch, shading.shape, false, counter);
  shading.scratch = counter.used;
  shading.shade = shade_tile;
}

}  // namespace ringlight::RINGLIGHT_ISA
