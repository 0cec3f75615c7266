#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <tuple>
#include <vector>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "simd/dispatch.hpp"
#include "trains/trains.hpp"

namespace ringlight {
namespace {

using Points = Tensor<const float, -1, 3>;
using Slots = Tensor<const std::int32_t, -1>;
using Numbers = Tensor<std::int32_t, -1>;
using Ends = Tensor<std::int64_t, -1>;
// Index and shares.
using NewBags = std::tuple<Tensor<std::int32_t, -1, 8>, Tensor<float, -1, 8>>;
using Bags = std::tuple<Tensor<const std::int32_t, -1, 8>, Tensor<const float, -1, 8>>;
// Levels, and those of them that tell blocks apart.
using Levels = std::tuple<int, int>;

TrainPoints points_from(const Points& places, const Levels& levels) {
  const auto [all, first] = levels;
  require(all > 0 && all <= convention::TRAIN_MOST_LEVELS && first >= 0 && first <= all,
          "trains: 1 to 10 levels, and 0 to all of them for blocks");
  return {places.data(), places.shape(0), all, first};
}

// Of each block its number among `blocks`.
void require_slots(const Slots& slots, const TrainPoints& points, std::size_t blocks) {
  require(slots.size() == std::size_t{1} << 3 * points.first, "trains: a slot for each block");
  for (std::size_t i = 0; i < slots.size(); i++)
    require(slots.data()[i] >= 0 && static_cast<std::size_t>(slots.data()[i]) < blocks,
            "trains: a slot is out of range");
}

void touch(const Points& places, const Levels& levels, Tensor<std::int8_t, -1> touched) {
  const TrainPoints points = points_from(places, levels);
  require(touched.size() == std::size_t{1} << 3 * points.first, "trains: a byte for each block");
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(train_touch)(points, touched.data());
}

void corners(const Points& places, const Levels& levels, const Slots& slots, std::size_t blocks, const NewBags& bags) {
  const TrainPoints points = points_from(places, levels);
  require_slots(slots, points, blocks);
  const int bits = 3 * (points.levels - points.first);
  require(blocks <= std::size_t{1} << (31 - bits), "trains: more entries than 2^31");
  const auto& [index, shares] = bags;
  require(index.shape(0) == points.count && shares.shape(0) == points.count, "trains: bags must be [N 8]");
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(train_corners)(points, slots.data(), {index.data(), shares.data()});
}

void count(const Points& places, const Levels& levels, const Slots& slots, Ends counts) {
  const TrainPoints points = points_from(places, levels);
  require_slots(slots, points, counts.size());
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(train_count)(points, slots.data(), counts.data());
}

void parts(const Points& places, const Levels& levels, const Slots& slots, Ends ends, Numbers owners,
           const NewBags& bags) {
  const TrainPoints points = points_from(places, levels);
  require_slots(slots, points, ends.size());
  const auto& [index, shares] = bags;
  require(index.shape(0) == owners.size() && shares.shape(0) == owners.size(), "trains: bags must be [Q 8]");
  std::vector<std::int64_t> counts(ends.size());
  RINGLIGHT_CHOSEN(train_count)(points, slots.data(), counts.data());
  std::int64_t begin = 0;
  for (std::size_t block = 0; block < counts.size(); begin += counts[block++])
    require(ends.data()[block] == begin, "trains: blocks must begin where those before them end");
  require(static_cast<std::size_t>(begin) == owners.size(), "trains: an owner for each part");
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(train_parts)(points, slots.data(), ends.data(), owners.data(), {index.data(), shares.data()});
}

TrainBags<const std::int32_t, const float> bags_from(const Bags& bags, std::size_t count, std::size_t rows) {
  const auto& [index, shares] = bags;
  require(index.shape(0) == count && shares.shape(0) == count, "trains: a bag for each sum");
  std::uint32_t highest = 0;  // of numbers as they are without a sign; no early end, so that lanes share the loop
  for (std::size_t i = 0; i < index.size(); i++)
    highest = std::max(highest, static_cast<std::uint32_t>(index.data()[i]));
  require(!index.size() || (highest >> 31 == 0 && highest < rows), "trains: a row is out of range");
  return {index.data(), shares.data()};
}

void gather(const Bags& bags, Tensor<const float, -1, -1> rows, Tensor<float, -1, -1> found) {
  require(rows.shape(1) == found.shape(1), "trains: sums must be as wide as rows");
  const auto from = bags_from(bags, found.shape(0), rows.shape(0));
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(train_gather)(from, found.shape(0), rows.shape(1), rows.data(), found.data());
}

void scatter(const Bags& bags, Tensor<const float, -1, -1> gradient, Tensor<float, -1, -1> rows) {
  require(rows.shape(1) == gradient.shape(1), "trains: sums must be as wide as rows");
  const auto from = bags_from(bags, gradient.shape(0), rows.shape(0));
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(train_scatter)(from, gradient.shape(0), rows.shape(1), gradient.data(), rows.data());
}

// Ends, owners, matrices [B C S], rows [M S].
using Blocks =
    std::tuple<Tensor<const std::int64_t, -1>, Slots, Tensor<const float, -1, -1, -1>, Tensor<const float, -1, -1>>;

TrainBlocks blocks_from(const Bags& bags, const Blocks& blocks, std::size_t points) {
  const auto& [ends, owners, matrices, rows] = blocks;
  const std::size_t count = owners.size();
  for (std::size_t part = 0; part < count; part++)
    require(owners.data()[part] >= 0 && static_cast<std::size_t>(owners.data()[part]) < points,
            "trains: an owner is out of range");
  require(ends.size() == matrices.shape(0) + 1 && ends.data()[0] == 0, "trains: an end for each matrix, and a zero");
  for (std::size_t block = 0; block + 1 < ends.size(); block++)
    require(ends.data()[block] <= ends.data()[block + 1], "trains: ends must rise");
  require(static_cast<std::size_t>(ends.data()[ends.size() - 1]) == count, "trains: ends must end with all bags");
  require(matrices.shape(2) == rows.shape(1) && matrices.shape(1) > 0 &&
              matrices.shape(1) <= convention::TRAIN_MOST_RANK && rows.shape(1) > 0 &&
              rows.shape(1) <= convention::TRAIN_MOST_RANK,
          "trains: matrices must be as wide as rows, from 1 to 4096");
  return {bags_from(bags, count, rows.shape(0)), ends.data(), owners.data(), points, matrices.shape(0),
          matrices.data(), rows.data(), matrices.shape(1), matrices.shape(2)};
}

void products(const Bags& bags, const Blocks& blocks, Tensor<float, -1, -1> found) {
  const TrainBlocks from = blocks_from(bags, blocks, found.shape(0));
  require(found.shape(1) == from.outputs, "trains: products must be [N C]");
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(train_products)(from, found.data());
}

void products_gradient(const Bags& bags, const Blocks& blocks, Tensor<const float, -1, -1> gradient,
                       Tensor<float, -1, -1, -1> grad_matrices, Tensor<float, -1, -1> grad_rows) {
  const TrainBlocks from = blocks_from(bags, blocks, gradient.shape(0));
  require(gradient.shape(1) == from.outputs, "trains: gradients must be [N C]");
  require(grad_matrices.shape(0) == from.count && grad_matrices.shape(1) == from.outputs &&
              grad_matrices.shape(2) == from.width && grad_rows.shape(1) == from.width &&
              grad_rows.shape(0) == std::get<3>(blocks).shape(0),
          "trains: gradients must be of all matrices and rows");
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(train_products_gradient)(from, grad_rows.shape(0), gradient.data(), grad_matrices.data(),
                                            grad_rows.data());
}

}  // namespace

void bind_trains(nb::module_& module) {
  module.def("train_touch", &touch, "places"_a, "levels"_a, "touched"_a, "Marks blocks with a node around a point.");
  module.def("train_corners", &corners, "places"_a, "levels"_a, "slots"_a, "blocks"_a, "bags"_a,
             "Of each point the entries around it, in blocks one after another, and their shares.");
  module.def("train_count", &count, "places"_a, "levels"_a, "slots"_a, "counts"_a,
             "Adds to each block's count the points with a node in it.");
  module.def("train_parts", &parts, "places"_a, "levels"_a, "slots"_a, "ends"_a, "owners"_a, "bags"_a,
             "Of each block the points with a node in it, and the entries and shares of these; `ends` are where blocks "
             "begin, and then where they end.");
  module.def("train_gather", &gather, "bags"_a, "rows"_a, "found"_a, "Sums of eight rows each, times their shares.");
  module.def("train_scatter", &scatter, "bags"_a, "gradient"_a, "rows"_a, "Adds the gradient of rows.");
  module.def("train_products", &products, "bags"_a, "blocks"_a, "found"_a,
             "Of each point the sum of its parts: of eight rows each, times the matrix of their block.");
  module.def("train_products_gradient", &products_gradient, "bags"_a, "blocks"_a, "gradient"_a, "grad_matrices"_a,
             "grad_rows"_a, "Gradients of matrices and rows.");
}

}  // namespace ringlight
