// A group of covered pixels on its way through the reflection shader: the forward pass, with everything that the
// backward pass needs left in place.
#pragma once
#include "machine/scratch.isa.hpp"
#include "reflection/lane_places.isa.hpp"
#include "reflection/rows.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

constexpr int HALVES = GROUP / LANES;

static inline int layer_inputs(const ReflectionShape& shape, int layer) {
  return layer ? shape.hidden : network_inputs(shape);
}
static inline int layer_outputs(const ReflectionShape& shape, int layer) {
  return layer + 1 < shape.layers ? shape.hidden : 3;
}

static inline int widest_layer(const ReflectionShape& shape) {
  return shape.hidden > network_inputs(shape) ? shape.hidden : network_inputs(shape);
}

template <Result Kind = Result::PLAIN>
static inline void apply(const Panels& layer, const float* from, float* terms, float* to) {
  dense<LayerTerms, Kind>(layer, feature_terms<LayerTerms>(from, layer.inputs, terms), to);
}

// What a call prepares once: layers in the order of use, maps sewn, spheres' sizes.
struct ReflectionTables {
  Panels layers[convention::REFLECTION_MAX_LAYERS];
  float* maps[convention::REFLECTION_MAX_SHELLS][convention::REFLECTION_MAX_LEVELS];
  float scale[convention::REFLECTION_MAX_SHELLS];
};

static inline ReflectionTables prepare(const ReflectionShape& shape, const ReflectionParameters<const float>& from,
                                       Arena& arena) {
  ReflectionTables tables;
  for (int layer = 0; layer < shape.layers; layer++) {
    const int inputs = layer_inputs(shape, layer), outputs = layer_outputs(shape, layer);
    float* to = arena.take(panel_floats<LayerTerms>(outputs, inputs));
    const auto& weights = from.mlp[layer];
    if (to) tables.layers[layer] = pack<LayerTerms>(weights.weight, inputs, 1, weights.bias, outputs, inputs, to);
  }
  for (int shell = 0; shell < shape.shells; shell++) {
    for (int level = 0; level < shape.levels; level++) {
      float* to = arena.take(level_size(shape, level));
      tables.maps[shell][level] = to;
      if (!to) continue;
      std::memcpy(to, from.maps[shell][level], level_size(shape, level) * sizeof(float));
      sew(to, shape.sides[level], shape.features);
    }
    alignas(64) float scale[LANES] = {};
    if (arena.block && shape.parallax) store(scale, exp(Vec(from.sphere[4 * shell + 3])));
    tables.scale[shell] = scale[0];
  }
  return tables;
}

struct ReflectionBatch {
  PixelLanes pixels[HALVES];
  Surface surfaces[HALVES];
  Exit exits[HALVES][convention::REFLECTION_MAX_SHELLS];
  LevelPoints points[HALVES][convention::REFLECTION_MAX_SHELLS][convention::REFLECTION_MAX_LEVELS];
  PlacePoints places[HALVES];
  float *inputs, *hidden[convention::REFLECTION_MAX_LAYERS - 1], *added;   // [n][GROUP]
  float *slopes_across, *slopes_down;           // [features][GROUP], or null in a pass without gradient
  float *factors, *plain;                       // of features, and these without; plain null as the slopes are
  float* terms;                                 // a layer's input as its multiply-adds take it
};

static inline void lay_out(ReflectionBatch& batch, const ReflectionShape& shape, bool slopes, Arena& arena) {
  batch.inputs = arena.take(static_cast<std::size_t>(GROUP) * network_inputs(shape));
  for (int layer = 0; layer + 1 < shape.layers; layer++)
    batch.hidden[layer] = arena.take(static_cast<std::size_t>(GROUP) * result_rows(shape.hidden));
  batch.added = arena.take(GROUP * 3);
  const std::size_t features = static_cast<std::size_t>(GROUP) * feature_count(shape) * slopes;
  batch.slopes_across = slopes ? arena.take(features) : nullptr;
  batch.slopes_down = slopes ? arena.take(features) : nullptr;
  const std::size_t factors = static_cast<std::size_t>(GROUP) * feature_count(shape) * (shape.axis_nodes > 0);
  batch.factors = arena.take(factors);
  batch.plain = slopes ? arena.take(factors) : nullptr;
  batch.terms = arena.take(static_cast<std::size_t>(GROUP) * result_rows(widest_layer(shape)));
}

// What does not change from group to group.
struct ReflectionScene {
  const ReflectionShape& shape;
  const ReflectionParameters<const float>& parameters;
  const ReflectionView& view;
  const ReflectionTables& tables;

  const float* sphere(int shell) const { return shape.parallax ? parameters.sphere + 4 * shell : nullptr; }
  // Where a level's features begin among all.
  int feature(int shell, int level) const { return (shell * shape.levels + level) * shape.features; }
};

template <bool Slopes>
static inline void read_maps(const ReflectionScene& scene, ReflectionBatch& batch, int half) {
  const ReflectionShape& shape = scene.shape;
  for (int shell = 0; shell < shape.shells; shell++) {
    Exit& exit = batch.exits[half][shell];
    leave(batch.surfaces[half], scene.sphere(shell), scene.tables.scale[shell], scene.view.smallest_chord, exit);
    for (int level = 0; level < shape.levels; level++) {
      LevelPoints& points = batch.points[half][shell][level];
      locate(exit.on_map, shape.sides[level], shape.features, points);
      const int first = scene.feature(shell, level) * GROUP + half * LANES;
      read_level<Slopes>({scene.tables.maps[shell][level], shape.sides[level], shape.features}, points, GROUP,
                         batch.inputs + features_input(shape) * GROUP + first,
                         Slopes ? batch.slopes_across + first : nullptr, Slopes ? batch.slopes_down + first : nullptr);
    }
  }
}

// From the inputs to what is added per alpha; the hidden layers are left in place.
static inline void run_network(const ReflectionScene& scene, ReflectionBatch& batch) {
  const float* from = batch.inputs;
  for (int layer = 0; layer + 1 < scene.shape.layers; from = batch.hidden[layer++])
    apply<Result::RECTIFIED>(scene.tables.layers[layer], from, batch.terms, batch.hidden[layer]);
  apply(scene.tables.layers[scene.shape.layers - 1], from, batch.terms, batch.added);
}

// The same bits where nobody asks for the hidden layers, whose places hold terms then.
static inline void run_network_once(const ReflectionShape& shape, const ReflectionTables& tables,
                                    ReflectionBatch& batch) {
  const float* terms = feature_terms<LayerTerms>(batch.inputs, network_inputs(shape), batch.terms);
  for (int layer = 0; layer + 1 < shape.layers; terms = batch.hidden[layer++])
    dense<LayerTerms, Result::RECTIFIED_TERMS>(tables.layers[layer], terms, batch.hidden[layer]);
  dense<LayerTerms>(tables.layers[shape.layers - 1], terms, batch.added);
}

// Multiplies the features of half a group by the factors of where they are seen.
template <bool Slopes>
static inline void multiply_features(const ReflectionScene& scene, ReflectionBatch& batch, int half) {
  const ReflectionShape& shape = scene.shape;
  float* const factors = batch.factors + half * LANES;
  float* const features = batch.inputs + features_input(shape) * GROUP + half * LANES;
  locate(shape, batch.surfaces[half], batch.places[half]);
  read_places(shape, scene.parameters.axes, batch.places[half], factors);
  for (int i = 0; i < feature_count(shape) * GROUP; i += GROUP) {
    const Vec feature = load(features + i);
    if constexpr (Slopes) store(batch.plain + half * LANES + i, feature);
    store(features + i, feature * load(factors + i));
  }
}

// The network's inputs for half a group.
template <bool Slopes>
static inline void look(const ReflectionScene& scene, ReflectionBatch& batch, int half) {
  see(scene.shape, scene.view, batch.pixels[half], batch.surfaces[half], batch.inputs + half * LANES);
  read_maps<Slopes>(scene, batch, half);
  if (scene.shape.axis_nodes) multiply_features<Slopes>(scene, batch, half);
}

// The group of packed pixels at `place`, from their surface to what is added per alpha.
template <bool Slopes>
static inline void evaluate(const ReflectionScene& scene, const PackedSurfaces& surfaces, int place,
                            ReflectionBatch& batch) {
  for (int half = 0; half < HALVES; half++) {
    batch.pixels[half] = lanes_at(surfaces, place + half * LANES);
    look<Slopes>(scene, batch, half);
  }
  Slopes ? run_network(scene, batch) : run_network_once(scene.shape, scene.tables, batch);
}

}  // namespace ringlight::RINGLIGHT_ISA
