// The backward pass of the reflection shader. Covered pixels are importance-sampled and dealt to a fixed number of
// shards, each with sums of its own for the parameters, which are added in order: the same bits for any number of
// threads.
#include "dense/shard_sums.isa.hpp"
#include "machine/parallel.hpp"
#include "machine/scratch.isa.hpp"
#include "raster/tile_pixels.isa.hpp"
#include "reflection/batch.isa.hpp"
#include "reflection/gradient_pixels.isa.hpp"
#include "reflection/reflection.hpp"
#include "step/importance_sampling.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

struct ParameterSums {
  float* maps;              // all levels of all shells, one after another
  float* sphere;            // [shells 4] by lanes
  float* axes;              // as the parameters
  LayerSums layers[convention::REFLECTION_MAX_LAYERS];
};

std::size_t maps_size(const ReflectionShape& shape) {
  std::size_t size = 0;
  for (int level = 0; level < shape.levels; level++) size += shape.shells * level_size(shape, level);
  return size;
}

ParameterSums lay_out_sums(const ReflectionShape& shape, Arena& arena) {
  ParameterSums sums;
  sums.maps = arena.take(maps_size(shape));
  sums.sphere = arena.take(static_cast<std::size_t>(4 * LANES) * shape.shells);
  sums.axes = arena.take(axes_size(shape));
  for (int layer = 0; layer < shape.layers; layer++) {
    const int inputs = layer_inputs(shape, layer), outputs = layer_outputs(shape, layer);
    float* weight = arena.take(weight_sums(outputs, inputs));
    sums.layers[layer] = {weight, arena.take(static_cast<std::size_t>(outputs) * LANES), outputs, inputs};
  }
  return sums;
}

// The transposed layers: from the gradient of what a layer returned to that of what it was given.
struct Transposed {
  Panels layers[convention::REFLECTION_MAX_LAYERS];
};

Transposed transpose_layers(const ReflectionShape& shape, const ReflectionParameters<const float>& from,
                            Arena& arena) {
  Transposed transposed;
  for (int layer = 0; layer < shape.layers; layer++) {
    const int inputs = layer_inputs(shape, layer), outputs = layer_outputs(shape, layer);
    const int wanted = layer ? inputs : direction_input(shape);  // the viewing direction's gradient is not
    float* to = arena.take(panel_floats<LayerTerms>(wanted, outputs));
    const float* weight = from.mlp[layer].weight;
    if (to) transposed.layers[layer] = pack<LayerTerms>(weight, 1, inputs, nullptr, wanted, outputs, to);
  }
  return transposed;
}

// Gradients of a group, [n][GROUP]; `rows` is a layer's input as to_rows leaves it.
struct BatchGradient {
  float *added, *hidden[convention::REFLECTION_MAX_LAYERS - 1], *inputs, *factors, *rows;
  float* terms;  // a gradient as multiply-adds take it
};

void lay_out_gradient(BatchGradient& gradient, const ReflectionShape& shape, Arena& arena) {
  gradient.added = arena.take(3 * GROUP);
  for (int layer = 0; layer + 1 < shape.layers; layer++)
    gradient.hidden[layer] = arena.take(static_cast<std::size_t>(shape.hidden) * GROUP);
  gradient.inputs = arena.take(static_cast<std::size_t>(network_inputs(shape)) * GROUP);
  gradient.factors = arena.take(static_cast<std::size_t>(GROUP) * feature_count(shape) * (shape.axis_nodes > 0));
  gradient.rows = arena.take(static_cast<std::size_t>(padded(widest_layer(shape))) * GROUP);
  gradient.terms = arena.take(static_cast<std::size_t>(result_rows(widest_layer(shape))) * GROUP);
}

struct Backward {
  const ReflectionScene& scene;
  const Transposed& transposed;
  const ReflectionBuffers<const float>& from;
  const std::int32_t* drawn;  // pixels
  const float* weights;       // what each counts
  const ReflectionBuffers<float>& to;
  std::int32_t* blocks;       // which pixels of each were drawn, bits
};

// What a shard has to itself: packed pixels, and a group of them.
struct Workplace {
  ReflectionBatch batch;
  BatchGradient gradient;
  PackedPixels pixels;
  PackedSurfaces surfaces;
  float *weights, *of_colors;     // [1] row, [3] rows
  ReflectionBuffers<float> of_values;
};

void lay_out_workplace(Workplace& place, const ReflectionShape& shape, Arena& arena) {
  lay_out(place.batch, shape, true, arena);
  lay_out_gradient(place.gradient, shape, arena);
  place.surfaces = lay_out_surfaces(shape, arena);
  place.weights = arena.take(PACKED_ROW);
  place.of_colors = arena.take(3 * PACKED_ROW);
  place.of_values = lay_out_rows(shape, shape.depth_gradient, arena);
}

// dL/dcolor to the gradient of what the network returned, by what the pixels count: nothing in lanes beyond the last.
Upstream start_gradient(const Workplace& place, int first, int half) {
  const int at = first + half * LANES;
  const Vec alpha = load(place.surfaces.values.alpha + at), weight = load(place.weights + at);
  Upstream upstream;
  upstream.alpha = Vec(0.f);
  for (int c = 0; c < 3; c++) {
    const int i = c * GROUP + half * LANES;
    upstream.color[c] = load(place.of_colors + c * PACKED_ROW + at);
    const Vec weighted = upstream.color[c] * weight;
    upstream.alpha = fma(weighted, load(place.batch.added + i), upstream.alpha);
    store(place.gradient.added + i, weighted * alpha);
  }
  return upstream;
}

// Adds to a layer's sums, given dL/d(its result) and its input, and leaves dL/d(its input) in `of_input`.
void layer_gradient(const LayerSums& sums, const Panels& transposed, const float* of_result, const float* input,
                    const BatchGradient& gradient, float* of_input) {
  to_rows<LayerTerms>(input, sums.inputs, gradient.rows);
  add_layer_gradient<LayerTerms>(sums, of_result, gradient.rows, gradient.terms);
  apply(transposed, of_result, gradient.terms, of_input);
}

// Through the network; leaves dL/d(inputs).
void network_gradient(const Backward& pass, const ReflectionBatch& batch, const BatchGradient& gradient,
                      const ParameterSums& sums) {
  const ReflectionShape& shape = pass.scene.shape;
  const float* of_output = gradient.added;
  for (int layer = shape.layers - 1; layer > 0; layer--) {
    float* of_input = gradient.hidden[layer - 1];
    layer_gradient(sums.layers[layer], pass.transposed.layers[layer], of_output, batch.hidden[layer - 1], gradient,
                   of_input);
    rectify_gradient(of_input, batch.hidden[layer - 1], shape.hidden);
    of_output = of_input;
  }
  layer_gradient(sums.layers[0], pass.transposed.layers[0], of_output, batch.inputs, gradient, gradient.inputs);
}

// Through the maps of half a group, which add their own; adds to the gradient of the reflected ray.
void map_gradient(const Backward& pass, const ReflectionBatch& batch, int half, const float* of_inputs,
                  const ParameterSums& sums, SurfaceGradient& gradient) {
  const ReflectionShape& shape = pass.scene.shape;
  float* map = sums.maps;
  for (int shell = 0; shell < shape.shells; shell++) {
    const Exit& exit = batch.exits[half][shell];
    Vec of_u(0.f), of_v(0.f), of_direction[3];
    for (int level = 0; level < shape.levels; map += level_size(shape, level++)) {
      const int side = shape.sides[level], first = pass.scene.feature(shell, level);
      const float* of_features = of_inputs + (features_input(shape) + first) * GROUP;
      add_to_level(map, side, shape.features, batch.points[half][shell][level], GROUP, of_features);
      Vec across(0.f), down(0.f);
      for (int k = 0; k < shape.features; k++) {
        const Vec of_feature = load(of_features + k * GROUP);
        const int i = (first + k) * GROUP + half * LANES;
        across = fma(of_feature, load(batch.slopes_across + i), across);
        down = fma(of_feature, load(batch.slopes_down + i), down);
      }
      const Vec cells(0.5f * static_cast<float>(side - 1));  // of the map per unit of the square
      of_u = fma(cells, across, of_u);
      of_v = fma(cells, down, of_v);
    }
    octahedral_gradient(exit.on_map, exit.direction, of_u, of_v, of_direction);
    leave_gradient(batch.surfaces[half], exit, pass.scene.tables.scale[shell], shape.parallax, of_direction, gradient,
                   sums.sphere + 4 * LANES * shell);
  }
}

// Turns the features' gradients into those of the maps' features, and adds that of their factors.
void factor_gradient(const Backward& pass, const ReflectionBatch& batch, int half, const BatchGradient& gradient,
                     const ParameterSums& sums, SurfaceGradient& of_surface) {
  const ReflectionShape& shape = pass.scene.shape;
  float* const of_features = gradient.inputs + features_input(shape) * GROUP + half * LANES;
  float* const of_factors = gradient.factors + half * LANES;
  for (int i = 0; i < feature_count(shape) * GROUP; i += GROUP) {
    const Vec of_feature = load(of_features + i);
    store(of_factors + i, of_feature * load(batch.plain + half * LANES + i));
    store(of_features + i, of_feature * load(batch.factors + half * LANES + i));
  }
  const auto go = shape.depth_gradient ? place_gradient<true> : place_gradient<false>;
  go(shape, pass.scene.parameters.axes, batch.surfaces[half], batch.places[half], of_factors, sums.axes, of_surface);
}

// Of the group of packed pixels at `first`.
void backpropagate(const Backward& pass, const Workplace& place, int first, const ParameterSums& sums) {
  const ReflectionScene& scene = pass.scene;
  const ReflectionBatch& batch = place.batch;
  const BatchGradient& gradient = place.gradient;
  Upstream upstream[HALVES];
  for (int half = 0; half < HALVES; half++) upstream[half] = start_gradient(place, first, half);
  network_gradient(pass, batch, gradient, sums);
  for (int half = 0; half < HALVES; half++) {
    const float* of_inputs = gradient.inputs + half * LANES;
    SurfaceGradient of_surface{{0.f, 0.f, 0.f}, {0.f, 0.f, 0.f}};
    if (scene.shape.axis_nodes) factor_gradient(pass, batch, half, gradient, sums, of_surface);
    map_gradient(pass, batch, half, of_inputs, sums, of_surface);
    see_gradient(scene.shape, scene.view, batch.surfaces[half], of_surface, upstream[half],
                 batch.inputs + half * LANES, of_inputs, from_place<float>(place.of_values, first + half * LANES));
  }
}

// The rows of the packed pixels to their blocks. rgb holds the gradient of the colour already, as if what is added were
// a constant: right for every pixel that is not shaded, and for those that were not drawn the part that does not go by
// the network. Of the other channels only blocks with a drawn pixel are read; 0 in their other pixels.
void write_blocks(const Backward& pass, const Workplace& place) {
  const ChannelRows<float> to(pass.scene.shape, pass.to, place.of_values);
  constexpr int BASE = 3;  // channels, the first
  place.pixels.for_each_step([&](std::size_t first, unsigned on, int row) {
    const std::size_t at = first / LANES * to.block;
    pass.blocks[first / LANES] = static_cast<std::int32_t>(on);
    for (int c = 0; c < BASE; c++) store_lanes(to.first[c] + at, expand_lanes(load(to.row[c] + row), on), on);
    for (int c = BASE; c < to.count; c++) store(to.first[c] + at, expand_lanes(load(to.row[c] + row), on));
  });
}

// The packed pixels, of which the first is number `begin` of those drawn.
void differentiate(const Backward& pass, std::size_t begin, Workplace& place, const ParameterSums& sums) {
  const ReflectionScene& scene = pass.scene;
  const PackedPixels& pixels = place.pixels;
  pack_blocks(scene.view, {scene.shape, pass.from, place.surfaces.values}, pixels, place.surfaces);
  pixels.for_each_step([&](std::size_t first, unsigned on, int row) {
    const float* const from = pass.to.rgb + first / LANES * pass.to.block;
    for (int c = 0; c < 3; c++)
      store(place.of_colors + c * PACKED_ROW + row, pack_lanes(load(from + c * pass.to.plane), on));
  });
  for (int c = 0; c < 3; c++) fill_up(pixels.count(), place.of_colors + c * PACKED_ROW);
  std::memcpy(place.weights, pass.weights + begin, pixels.count() * sizeof(float));
  std::memset(place.weights + pixels.count(), 0, GROUP * sizeof(float));
  for (int first = 0; first < pixels.count(); first += GROUP) {
    evaluate<true>(scene, place.surfaces, first, place.batch);
    backpropagate(pass, place, first, sums);
  }
}

// dL/dcolor of a picture to the rgb of blocks.
void colors_to_tiles(const Camera& camera, const float* color_gradient, const ReflectionBuffers<float>& to) {
  const std::size_t stride = static_cast<std::size_t>(camera.width), size = stride * camera.height;
  const int across = (camera.width + convention::TILE - 1) / convention::TILE;
  const std::size_t tiles = tile_pixels(camera) / TILE_PIXELS;
  parallel_for(tiles, [&](std::size_t number) {
    const int n = static_cast<int>(number);
    const Tile tile{n, n % across * convention::TILE, n / across * convention::TILE, 0, 0, 0};
    for (int c = 0; c < 3; c++)
      for_each_quartet(camera, tile, [&](const Quartet& quartet) {
        Vec blocks[QUARTET];
        load_quartet(color_gradient + c * size, stride, quartet, blocks);
        float* const first = to.rgb + c * to.plane + (number * BLOCKS + quartet.first_block) * to.block;
        for (int k = 0; k < QUARTET; k++) store(first + k * to.block, blocks[k]);
      });
  });
}

void run_shard(const Backward& pass, const ShardRange& range, float* zeroed) {
  const ReflectionShape& shape = pass.scene.shape;
  Arena of_sums{zeroed};
  const ParameterSums sums = lay_out_sums(shape, of_sums);
  std::memset(zeroed, 0, of_sums.used * sizeof(float));
  Workplace place;
  Arena needed{nullptr};
  lay_out_workplace(place, shape, needed);
  const Scratch memory(needed.used * sizeof(float));
  Arena scratch{memory.floats()};
  lay_out_workplace(place, shape, scratch);
  const MatrixUnit unit;
  for (std::size_t at = range.begin; at < range.end;) {
    place.pixels.clear();
    const std::size_t next = add_listed(pass.drawn, at, range.end, place.pixels);
    differentiate(pass, at, place, sums);
    write_blocks(pass, place);
    at = next;
  }
}

void add_up_shards(const ReflectionShape& shape, const Shards& shards, const ReflectionParameters<float>& to) {
  Arena first{const_cast<float*>(shards.sums)};
  const ParameterSums sums = lay_out_sums(shape, first);
  const float* map = sums.maps;
  for (int shell = 0; shell < shape.shells; shell++) {
    for (int level = 0; level < shape.levels; map += level_size(shape, level++)) {
      const std::size_t row = static_cast<std::size_t>(shape.sides[level]) * shape.features;
      add_up_rows(shards, map, row, shape.sides[level], row, to.maps[shell][level]);
      sew(to.maps[shell][level], shape.sides[level], shape.features);
    }
    for (int i = 4 * shell; i < 4 * shell + 4 && shape.parallax; i++) {
      Vec lanes(0.f);
      for (int shard = 0; shard < shards.count; shard++)
        lanes += load(sums.sphere + shard * shards.stride + i * LANES);
      to.sphere[i] = sum(lanes);
    }
  }
  if (const std::size_t row = feature_count(shape); shape.axis_nodes)
    add_up_rows(shards, sums.axes, row, static_cast<std::size_t>(3) * shape.axis_nodes, row, to.axes);
  for (int layer = 0; layer < shape.layers; layer++)
    add_up_layer(shards, sums.layers[layer], to.mlp[layer].weight, to.mlp[layer].bias);
}

}  // namespace

void reflection_backward(const ReflectionShape& shape, const ReflectionParameters<const float>& parameters,
                         const ReflectionView& view, const ReflectionBuffers<const float>& buffers,
                         const float* color_gradient, double share, const ReflectionParameters<float>& gradients,
                         const ReflectionBuffers<float>& buffer_gradients, std::int32_t* blocks) {
  const std::size_t pixels = tile_pixels(view.camera);
  colors_to_tiles(view.camera, color_gradient, buffer_gradients);
  std::memset(blocks, 0, pixels / LANES * sizeof *blocks);
  const Scratch list((pixels + LANES) * sizeof(std::int32_t)), counts((pixels + LANES) * sizeof(float));
  auto* const drawn = static_cast<std::int32_t*>(list.data());
  float* const weights = counts.floats();
  const std::size_t with_gradient =
      list_with_gradient(buffers, view.faintest, buffer_gradients, pixels / LANES, drawn, weights);
  const std::size_t count = sample_measured(share, with_gradient, drawn, weights);
  Arena counter{nullptr}, of_shard{nullptr};
  prepare(shape, parameters, counter);
  transpose_layers(shape, parameters, counter);
  lay_out_sums(shape, of_shard);
  const int shards = shard_count(count);
  const Scratch memory((counter.used + of_shard.used * shards) * sizeof(float));
  Arena arena{memory.floats()};
  const ReflectionTables tables = prepare(shape, parameters, arena);
  const Transposed transposed = transpose_layers(shape, parameters, arena);
  float* const sums = arena.take(of_shard.used * shards);
  const ReflectionScene scene{shape, parameters, view, tables};
  const Backward pass{scene, transposed, buffers, drawn, weights, buffer_gradients, blocks};
  parallel_for(shards, [&](std::size_t shard) {
    run_shard(pass, range_of(drawn, count, shard, shards), sums + shard * of_shard.used);
  });
  add_up_shards(shape, {sums, of_shard.used, shards}, gradients);
}

}  // namespace ringlight::RINGLIGHT_ISA
