// What bindings of volumes take.
#pragma once
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <array>
#include <cstdint>
#include <optional>
#include <tuple>
#include <vector>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "volume/volume.hpp"

namespace ringlight {

using Points = Tensor<const float, -1, 3>;
using Numbers = Tensor<const std::int32_t, -1>;
using Inputs = std::vector<Input>;
using Arrays = std::vector<Array>;

// Three planes, then three lines; or three lines alone.
template <class Float, class Tensors>
inline VolumeFactors<Float> factors_from(const Tensors& tensors) {
  require(tensors.size() == 6 || tensors.size() == 3, "volume: three planes and three lines, or three lines");
  VolumeFactors<Float> made{};
  const bool has_planes = tensors.size() == 6;
  const std::size_t first = has_planes ? 3 : 0;
  constexpr auto& axes = VOLUME_PAIR_AXES;
  require(tensors[first].ndim() == 2, "volume: lines must be [S C]");
  const std::size_t components = tensors[first].shape(1);
  require(components > 0 && components <= convention::VOLUME_MOST_COMPONENTS &&
              components % convention::VOLUME_COMPONENT_LANES == 0,
          "volume: components must be a multiple of 16");
  made.components = static_cast<int>(components);
  for (std::size_t k = 0; k < 3; k++) {
    const auto& line = tensors[first + k];
    require(line.ndim() == 2 && line.shape(1) == components && line.shape(0) >= 2 &&
                line.shape(0) <= convention::VOLUME_MOST_NODES,
            "volume: lines must be [S C] of 2 to 4096 nodes");
    made.sides[has_planes ? axes[k][2] : static_cast<int>(k)] = static_cast<int>(line.shape(0));
    made.lines[k] = line.data();
  }
  for (std::size_t pair = 0; pair < first; pair++) {
    const auto& plane = tensors[pair];
    require(plane.ndim() == 3 && plane.shape(2) == components &&
                plane.shape(1) == static_cast<std::size_t>(made.sides[axes[pair][0]]) &&
                plane.shape(0) == static_cast<std::size_t>(made.sides[axes[pair][1]]),
            "volume: planes must be [S_b S_a C] of the lines' nodes");
    made.planes[pair] = plane.data();
  }
  return made;
}

inline void require_numbers(const Numbers& numbers, std::size_t below) {
  for (std::size_t i = 0; i < numbers.size(); i++)
    require(numbers.data()[i] >= 0 && static_cast<std::size_t>(numbers.data()[i]) < below,
            "volume: a number of a sample or ray is out of range");
}

}  // namespace ringlight
