// Groups' light by the matrix unit, with a Gaussian to a row from the ring's product to the residual colour:
// multiply() and shade() of the forward pass (product.isa.hpp, batch.isa.hpp), where rank and layers allow it.
#pragma once
#include "dense/row_layers.isa.hpp"
#include "ring/product_pairs.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

template <class Terms>
static inline bool lit_by_rows(const RingShape& shape) {
  // Hidden layers leave whole steps.
  const bool wide = shape.render_hidden > LANES && (!modulated(shape) || shape.modulation_hidden > LANES);
  return in_unit<Terms> && shape.rank == PAIR_RANK && !shape.diagonal && wide;
}

// The parameters in the order of use. The networks' first layers take the features first, and behind them what else
// they see: the direction, or modulation, base colour and latents.
struct RowField {
  PairTables tables;
  RowPanels core, modulation[2], render[3];
};

template <class Pairs, class Terms>
static inline RowField pack_row_field(const RingShape& shape, const RingParameters<const float>& from, Arena& arena) {
  const auto packed = [&](const RingLayer<const float>& layer, int outputs, int inputs, auto place) {
    return pack_rows<Terms>(layer.weight, inputs, layer.bias, outputs, inputs, arena, place);
  };
  const auto in_order = [](int k) { return k; };
  const int features = shape.features, hidden = shape.render_hidden;
  RowField field;
  field.tables = pack_pairs<Pairs>(shape, from, arena);
  int element[PAIR_MATRIX];
  for (int i = 0; i < PAIR_RANK; i++)
    for (int j = 0; j < PAIR_RANK; j++) element[left_place(i, j)] = i * PAIR_RANK + j;
  field.core = packed({from.core, nullptr}, features, PAIR_MATRIX, [&](int k) { return element[k]; });
  if (modulated(shape)) {
    const int inputs = modulation_inputs(shape);
    field.modulation[0] = packed(from.modulation[0], shape.modulation_hidden, inputs,
                                 [=](int k) { return k < features ? k + 3 : k - features; });
    field.modulation[1] = packed(from.modulation[1], 1, shape.modulation_hidden, in_order);
  }
  field.render[0] = packed(from.render[0], hidden, render_inputs(shape), in_order);
  field.render[1] = packed(from.render[1], hidden, hidden, in_order);
  field.render[2] = packed(from.render[2], 3, hidden, in_order);
  return field;
}

// Room of a group.
struct RowGroup {
  float *products;             // [GROUP][R^2]
  float *inputs;               // [GROUP][input_width]: the networks' inputs
  float *sums;                 // [GROUP][width] of any layer
  float *terms, *other_terms;  // of any layer's input
};

static inline int larger(int a, int b) { return a > b ? a : b; }

// Floats of a Gaussian's inputs to either network.
static inline int input_width(const RingShape& shape) {
  return row_steps(larger(modulation_inputs(shape), render_inputs(shape))) * STEP_INPUTS;
}

static inline RowGroup lay_out_rows(const RingShape& shape, Arena& arena) {
  const int hidden = larger(shape.render_hidden, shape.modulation_hidden);
  const int widest = row_steps(larger(shape.features, hidden)) * STEP_INPUTS;
  const int inputs = larger(larger(widest, input_width(shape)), PAIR_MATRIX);
  RowGroup group;
  group.products = arena.take(static_cast<std::size_t>(GROUP) * PAIR_MATRIX);
  group.inputs = arena.take(static_cast<std::size_t>(GROUP) * input_width(shape));
  group.sums = arena.take(static_cast<std::size_t>(GROUP) * widest);
  group.terms = arena.take(row_terms(inputs));
  group.other_terms = arena.take(row_terms(inputs));
  return group;
}

// Columns [count][GROUP] behind the features of every Gaussian.
static inline void add_inputs(const float* columns, int count, int first, int width, float* inputs) {
  for (int i = 0; i < GROUP; i++)
    for (int c = 0; c < count; c++) inputs[i * width + first + c] = columns[c * GROUP + i];
}

// Numbers 0 .. count - 1 of sums[GROUP][LANES], as columns.
static inline void to_columns(const float* sums, int count, float* columns) {
  for (int i = 0; i < GROUP; i++)
    for (int c = 0; c < count; c++) columns[c * GROUP + i] = sums[i * LANES + c];
}

// tanh of the core's sums, at the head of the networks' inputs; the rest of these is zero.
static inline void activate_rows(const RingShape& shape, const RowGroup& group) {
  const int from = row_width(shape.features), to = input_width(shape);
  for (int i = 0; i < GROUP; i++)
    for (int c = 0; c < to; c += LANES)
      store(group.inputs + i * to + c, c < from ? tanh_fast(load(group.sums + i * from + c)) : Vec(0.f));
}

// A group on its way.
struct LitGroup {
  Batch batch;
  RowGroup rows;
};

// Leaves the residual colours, and modulation, of `Count` groups that were started. Stage by stage, because tiles wait
// until memory has what was stored: meanwhile it is another group's turn.
template <class Unit, class Pairs, class Terms, int Count>
static inline void light_rows(LitGroup* groups, const RingShape& shape, const RowField& field) {
  const auto each = [groups](auto run) __attribute__((always_inline)) {
    for (int i = 0; i < Count; i++) run(groups[i].batch, groups[i].rows);
  };
  const int width = input_width(shape);
  const auto input_terms = [width](RowGroup& rows) {
    terms_of_rows<Terms>(rows.inputs, width, rows.terms, [](Vec value) { return value; });
  };
  const auto layer = [&each](const RowPanels& panels, float* RowGroup::* from) __attribute__((always_inline)) {
    each([&](Batch&, RowGroup& rows) { dense_rows<Unit>(panels, rows.*from, rows.sums); });
  };
  const auto rectified = [&each](const RowPanels& panels, float* RowGroup::* to) __attribute__((always_inline)) {
    each([&](Batch&, RowGroup& rows) {
      terms_of_rows<Terms>(rows.sums, panels.outputs, rows.*to, [](Vec sum) { return max(Vec(0.f), sum); });
    });
  };
  each([&](Batch& batch, RowGroup& rows) {
    multiply_pairs<Pairs, Terms>(batch, shape, field.tables, rows.products, rows.terms);
  });
  layer(field.core, &RowGroup::terms);
  each([&](Batch&, RowGroup& rows) { activate_rows(shape, rows); });
  if (modulated(shape)) {
    each([&](Batch& batch, RowGroup& rows) { add_inputs(batch.inputs, 3, shape.features, width, rows.inputs); });
    each([&](Batch&, RowGroup& rows) { input_terms(rows); });
    layer(field.modulation[0], &RowGroup::terms);
    rectified(field.modulation[0], &RowGroup::other_terms);
    layer(field.modulation[1], &RowGroup::other_terms);
    each([&](Batch& batch, RowGroup& rows) {
      to_columns(rows.sums, 1, batch.modulation);
      for (int i = 0; i < GROUP; i += LANES) store(batch.modulation + i, sigmoid(load(batch.modulation + i)));
    });
  }
  each([&](Batch& batch, RowGroup& rows) {
    const int features = shape.features;
    add_inputs(batch.activated + features * GROUP, render_inputs(shape) - features, features, width, rows.inputs);
  });
  each([&](Batch&, RowGroup& rows) { input_terms(rows); });
  layer(field.render[0], &RowGroup::terms);
  rectified(field.render[0], &RowGroup::other_terms);
  layer(field.render[1], &RowGroup::other_terms);
  rectified(field.render[1], &RowGroup::terms);
  layer(field.render[2], &RowGroup::terms);
  each([&](Batch& batch, RowGroup& rows) {
    to_columns(rows.sums, 3, batch.residual);
    for (int i = 0; i < 3 * GROUP; i += LANES) store(batch.residual + i, tanh_fast(load(batch.residual + i)));
  });
}

}  // namespace ringlight::RINGLIGHT_ISA
