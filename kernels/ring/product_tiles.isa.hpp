// The ring's product and its gradient in pairs of bfloat16, one Gaussian at a time, for ranks 4, 8 and 16: a tile of
// 4 x 4 elements is one Vec, four rows of four. In a product, tile (h, c) = sum over k of column k of rows 4 h .. 4 h
// + 3 times row k of columns 4 c .. 4 c + 3: the one is a lane in each quarter, the other a quarter, and one
// multiply-add takes two k.
#pragma once
#include "ring/batch.isa.hpp"
#include "ring/sums.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

// What is multiplied at once: one matrix, or two of rank 4, so that their pairs fill a Vec.
template <int Rank>
struct TileUnit {
  static constexpr int SIDE = Rank / TILE, MATRICES = SIDE == 1 ? 2 : 1, COUNT = GROUP / MATRICES;
  static constexpr int TILES = SIDE * SIDE, FLOATS = MATRICES * TILES, PACKED = FLOATS / 2;  // Vecs
};

// A unit's matrices as factors. By rows: pairs of columns, for the left factor. By columns: pairs of rows, for the
// right one. Tiles pair as 2 m and 2 m + 1: [h][m] by rows, [m][c] by columns.
template <class Terms, int Rank>
struct Factor {
  Terms pairs[TileUnit<Rank>::PACKED];
};

template <class Terms, int Rank>
RINGLIGHT_INLINE Factor<Terms, Rank> by_rows_of(const Vec* tiles) {
  Factor<Terms, Rank> factor;
  if constexpr (Rank == TILE) {
    factor.pairs[0] = Terms::two_by_rows(tiles[0], tiles[1]);
  } else {
#pragma GCC unroll 8
    for (int i = 0; i < TileUnit<Rank>::PACKED; i++) factor.pairs[i] = Terms::of(tiles[2 * i], tiles[2 * i + 1]);
  }
  return factor;
}

template <class Terms, int Rank>
RINGLIGHT_INLINE Factor<Terms, Rank> by_columns_of(const Vec* tiles) {
  constexpr int SIDE = TileUnit<Rank>::SIDE;
  Factor<Terms, Rank> factor;
  if constexpr (Rank == TILE) {
    factor.pairs[0] = Terms::two_by_columns(tiles[0], tiles[1]);
  } else {
#pragma GCC unroll 2
    for (int m = 0; m < SIDE / 2; m++)
#pragma GCC unroll 4
      for (int c = 0; c < SIDE; c++)
        factor.pairs[m * SIDE + c] = Terms::of(tiles[2 * m * SIDE + c], tiles[(2 * m + 1) * SIDE + c]);
  }
  return factor;
}

// The transposed matrices, by rows or by columns: each pair of the other factor, turned.
template <bool ByRows, class Terms, int Rank>
RINGLIGHT_INLINE Factor<Terms, Rank> transposed_of(const Vec* tiles) {
  constexpr int SIDE = TileUnit<Rank>::SIDE, PAIRS = Rank == TILE ? 1 : SIDE / 2;
  const Factor<Terms, Rank> other = ByRows ? by_columns_of<Terms, Rank>(tiles) : by_rows_of<Terms, Rank>(tiles);
  Factor<Terms, Rank> factor;
#pragma GCC unroll 4
  for (int c = 0; c < SIDE; c++)
#pragma GCC unroll 2
    for (int m = 0; m < PAIRS; m++) {
      const int row = c * PAIRS + m, column = m * SIDE + c;
      factor.pairs[ByRows ? row : column] = other.pairs[ByRows ? column : row].turned();
    }
  return factor;
}

// Adds the part of pairs 4 m + J and on.
template <int J, class Terms, int Rank>
RINGLIGHT_INLINE void add_tile_products(const Factor<Terms, Rank>& a, const Factor<Terms, Rank>& b, int m, Vec* tiles) {
  constexpr int SIDE = TileUnit<Rank>::SIDE;
  if constexpr (Rank == TILE) {
    tiles[J / 2] = fma(a.pairs[0].template lane_in_quarters<J>(), b.pairs[0].template quarter<J>(), tiles[J / 2]);
  } else {
    Terms right[SIDE];
#pragma GCC unroll 4
    for (int c = 0; c < SIDE; c++) right[c] = b.pairs[m * SIDE + c].template quarter<J>();
#pragma GCC unroll 4
    for (int h = 0; h < SIDE; h++) {
      const Terms left = a.pairs[h * SIDE / 2 + m].template lane_in_quarters<J>();
#pragma GCC unroll 4
      for (int c = 0; c < SIDE; c++) tiles[h * SIDE + c] = fma(left, right[c], tiles[h * SIDE + c]);
    }
  }
  if constexpr (J + 1 < TILE) add_tile_products<J + 1>(a, b, m, tiles);
}

// tiles = a b, a by rows and b by columns.
template <class Terms, int Rank>
RINGLIGHT_INLINE void tile_product(const Factor<Terms, Rank>& a, const Factor<Terms, Rank>& b, Vec* tiles) {
#pragma GCC unroll 16
  for (int i = 0; i < TileUnit<Rank>::FLOATS; i++) tiles[i] = Vec(0.f);
  add_tile_products<0>(a, b, 0, tiles);
  if constexpr (Rank == 4 * TILE) add_tile_products<0>(a, b, 1, tiles);
}

// Which Gaussian a unit's matrix belongs to. Two of rank 4 come from the two halves, so that the transposed product has
// them in order.
template <int Rank>
RINGLIGHT_INLINE int lane_of(int unit, int matrix) {
  return TileUnit<Rank>::MATRICES == 2 ? matrix * LANES + unit : unit;
}

// The tables as one group reads them.
template <class Terms>
struct GroupTables {
  const Batch& batch;
  const RingShape& shape;
  const CellTables& tables;
  CellWeights<Terms> weights[2];
};

constexpr int HEADS = 4, VIEW = 3;  // H_x, H_y, H_z, and H_v

// A unit's matrices of one head, interpolated.
template <class Terms, int Rank>
RINGLIGHT_INLINE void read_unit(const GroupTables<Terms>& from, int head, int unit, Vec* tiles) {
  using Unit = TileUnit<Rank>;
  constexpr std::size_t WIDTH = Rank * Rank;
#pragma GCC unroll 2
  for (int matrix = 0; matrix < Unit::MATRICES; matrix++) {
    const int half = lane_of<Rank>(unit, matrix) / LANES, lane = unit % LANES;
    const RingHalf& cells = from.batch.halves[half];
    const CellWeights<Terms>& weights = from.weights[half];
    if (head == VIEW) {
      const std::size_t cell = static_cast<std::size_t>(cells.down.cell[lane]) * from.shape.view_nodes +
                               static_cast<std::size_t>(cells.across.cell[lane]);
      const float* const at = from.tables.view + 2 * WIDTH * cell;
      const Terms upper(weights.upper[lane]), lower(weights.lower[lane]);
#pragma GCC unroll 16
      for (int i = 0; i < Unit::TILES; i++) {
        const Vec above = fma(Terms(load(at + i * LANES)), upper, Vec(0.f));
        tiles[matrix * Unit::TILES + i] = fma(Terms(load(at + WIDTH + i * LANES)), lower, above);
      }
    } else {
      const std::size_t cell = static_cast<std::size_t>(head) * from.shape.nodes +
                               static_cast<std::size_t>(cells.axes[head].cell[lane]);
      const float* const at = from.tables.axes + WIDTH * cell;
      const Terms weight(weights.axis[head][lane]);
#pragma GCC unroll 16
      for (int i = 0; i < Unit::TILES; i++)
        tiles[matrix * Unit::TILES + i] = fma(Terms(load(at + i * LANES)), weight, Vec(0.f));
    }
  }
}

// What the gradient needs of a unit: every matrix transposed.
template <class Terms, int Rank>
struct UnitTransposes {
  Factor<Terms, Rank> left[HEADS - 1];   // H_x, H_x H_y, H_x H_y H_z by rows
  Factor<Terms, Rank> right[HEADS - 1];  // H_y, H_z, H_v by columns
};

// products[unit] to terms of the core layer, [R^2 / 2][GROUP].
template <class Terms, int Rank>
static inline void products_to_terms(const Factor<Terms, Rank>* products, float* terms) {
  constexpr int PACKED = TileUnit<Rank>::PACKED;
  for (int first = 0; first < TileUnit<Rank>::COUNT; first += LANES)
    for (int i = 0; i < PACKED; i++) {
      Vec square[LANES];
#pragma GCC unroll 16
      for (int unit = 0; unit < LANES; unit++) square[unit] = products[first + unit].pairs[i].bits();
      transpose(square);
      for (int k = 0; k < LANES; k++) {
        // Of rank 4 the last eight are the other half's.
        const int term = Rank == TILE ? k % 8 : i * LANES + k, half = Rank == TILE ? k / 8 * LANES : first;
        store(terms + term * GROUP + half, square[k]);
      }
    }
}

// The product of the heads before with one more, for all units; the last one is left as numbers in order. Head by head,
// because the chain of one unit is long: so the processor has many at hand.
template <class Terms, int Rank, bool Keep>
static inline void multiply_by(const GroupTables<Terms>& from, int head, Factor<Terms, Rank>* products,
                               UnitTransposes<Terms, Rank>* kept) {
  using Unit = TileUnit<Rank>;
  for (int unit = 0; unit < Unit::COUNT; unit++) {
    Vec read[Unit::FLOATS], tiles[Unit::FLOATS];
    read_unit<Terms, Rank>(from, head, unit, read);
    tile_product(products[unit], by_columns_of<Terms, Rank>(read), tiles);
    if constexpr (Keep) {
      kept[unit].right[head - 1] = transposed_of<false, Terms, Rank>(read);
      if (head != VIEW) kept[unit].left[head] = transposed_of<true, Terms, Rank>(tiles);
    }
    if (head != VIEW) {
      products[unit] = by_rows_of<Terms, Rank>(tiles);
    } else {
#pragma GCC unroll 8
      for (int i = 0; i < Unit::PACKED; i++)
        products[unit].pairs[i] = Terms::of_neighbours(tiles[2 * i], tiles[2 * i + 1]);
    }
  }
}

// Leaves the product as terms in batch.product, [R^2 / 2][GROUP], and with Keep what the gradient needs of it.
template <class Terms, int Rank, bool Keep>
static void multiply_tiles(Batch& batch, const RingShape& shape, const CellTables& tables) {
  using Unit = TileUnit<Rank>;
  const GroupTables<Terms> from{
      batch,
      shape,
      tables,
      {CellWeights<Terms>(cells_of(batch.halves[0])), CellWeights<Terms>(cells_of(batch.halves[1]))}};
  auto* const products = reinterpret_cast<Factor<Terms, Rank>*>(batch.packed_products);
  auto* const kept = reinterpret_cast<UnitTransposes<Terms, Rank>*>(batch.transposes);
  for (int unit = 0; unit < Unit::COUNT; unit++) {
    Vec read[Unit::FLOATS];
    read_unit<Terms, Rank>(from, 0, unit, read);
    products[unit] = by_rows_of<Terms, Rank>(read);
    if constexpr (Keep) kept[unit].left[0] = transposed_of<true, Terms, Rank>(read);
  }
  multiply_by<Terms, Rank, Keep>(from, 1, products, kept);
  multiply_by<Terms, Rank, Keep>(from, 2, products, kept);
  multiply_by<Terms, Rank, Keep>(from, VIEW, products, kept);
  products_to_terms<Terms, Rank>(products, batch.product);
}

// batch.packed_products as to_rows leaves the core layer's input.
template <class Terms, int Rank>
static inline void product_rows(const Batch& batch, float* rows) {
  constexpr int PACKED = TileUnit<Rank>::PACKED, BLOCK = GROUP_TERMS<Terms> * LANES;
  const auto* const products = reinterpret_cast<const Factor<Terms, Rank>*>(batch.packed_products);
  for (int pair = 0; 2 * pair < TileUnit<Rank>::COUNT; pair++)
#pragma GCC unroll 8
    for (int i = 0; i < PACKED; i++) {
      const Terms first = products[2 * pair].pairs[i], second = products[2 * pair + 1].pairs[i];
      // Of rank 4 the second sixteen are the other half's.
      float* const to = rows + 2 * i * BLOCK + pair * LANES;
      store(to, Terms::template side_by_side<0>(first, second));
      store(to + (Rank == TILE ? LANES * LANES / 2 : BLOCK), Terms::template side_by_side<1>(first, second));
    }
}

// From dL/d(product), [R^2][GROUP] in the order of tiles, to the tables. `rows` has room for it.
template <class Terms, int Rank>
static void ring_gradient_tiles(const Batch& batch, const RingShape& shape, const float* of_product,
                                const ShardSums& sums, float* rows) {
  using Unit = TileUnit<Rank>;
  constexpr int WIDTH = Rank * Rank;
  for (int half = 0; half < GROUP; half += LANES)
    for (int first = 0; first < WIDTH; first += LANES) {
      Vec square[LANES];
      for (int i = 0; i < LANES; i++) square[i] = load(of_product + (first + i) * GROUP + half);
      transpose(square);
      for (int lane = 0; lane < LANES; lane++) store(rows + (half + lane) * WIDTH + first, square[lane]);
    }
  const std::size_t line = static_cast<std::size_t>(WIDTH) * shape.view_nodes;
  for (int unit = 0; unit < Unit::COUNT; unit++) {
    const auto& of = reinterpret_cast<const UnitTransposes<Terms, Rank>*>(batch.transposes)[unit];
    Vec product[Unit::FLOATS], by_view[Unit::FLOATS], by_x[Unit::FLOATS], by_y[Unit::FLOATS], by_z[Unit::FLOATS];
    Vec upstream[Unit::FLOATS];
#pragma GCC unroll 16
    for (int tile = 0; tile < Unit::FLOATS; tile++) {
      product[tile] = load(rows + lane_of<Rank>(unit, tile / Unit::TILES) * WIDTH + tile % Unit::TILES * LANES);
    }
    tile_product(of.left[2], by_columns_of<Terms, Rank>(product), by_view);
    tile_product(by_rows_of<Terms, Rank>(product), of.right[2], upstream);  // by H_x H_y H_z
    tile_product(of.left[1], by_columns_of<Terms, Rank>(upstream), by_z);
    tile_product(by_rows_of<Terms, Rank>(upstream), of.right[1], upstream);  // by H_x H_y
    tile_product(of.left[0], by_columns_of<Terms, Rank>(upstream), by_y);
    tile_product(by_rows_of<Terms, Rank>(upstream), of.right[0], by_x);
    for (int matrix = 0; matrix < Unit::MATRICES; matrix++) {
      const int half = lane_of<Rank>(unit, matrix) / LANES;
      const RingPlace at(shape, cells_of(batch.halves[half]), unit % LANES);
      const auto scatter = [](float* below, Vec value, Vec weight) {
        const Vec above = value * weight;
        store(below, load(below) + value - above);
        store(below + WIDTH, load(below + WIDTH) + above);
      };
      for (int i = 0; i < Unit::TILES; i++) {
        const int tile = matrix * Unit::TILES + i, first = i * LANES;
        const Vec lower = by_view[tile] * at.down;
        scatter(sums.view + at.view + first, by_view[tile] - lower, at.right);
        scatter(sums.view + at.view + line + first, lower, at.right);
        scatter(sums.axes + at.axis[2] + first, by_z[tile], at.fraction[2]);
        scatter(sums.axes + at.axis[1] + first, by_y[tile], at.fraction[1]);
        scatter(sums.axes + at.axis[0] + first, by_x[tile], at.fraction[0]);
      }
    }
  }
}

// Calls `run` with the rank as a type that has it as VALUE, if matrices are multiplied tile by tile.
template <int Rank>
struct RankOf {
  static constexpr int VALUE = Rank;
};

template <class Terms, class Run>
static inline bool with_tiles(const RingShape& shape, Run run) {
  if (!in_tiles<Terms>(shape)) return false;
  if constexpr (numbers_of<Terms> == 2) {
    if (shape.rank == 4) run(RankOf<4>{});
    if (shape.rank == 8) run(RankOf<8>{});
    if (shape.rank == 16) run(RankOf<16>{});
  }
  return true;
}

}  // namespace ringlight::RINGLIGHT_ISA
