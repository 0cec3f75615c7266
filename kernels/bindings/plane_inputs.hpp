// Planes and lines as Python hands them over.
#pragma once
#include <nanobind/stl/vector.h>

#include <vector>

#include "bindings/arrays.hpp"
#include "convention.hpp"
#include "planes/planes.hpp"

namespace ringlight {

template <class Float>
using Planes = std::vector<Tensor<Float, -1, -1, -1>>;
template <class Float>
using Lines = std::vector<Tensor<Float, -1, -1>>;

template <class Float>
PlaneShape shape_of(const Planes<Float>& planes, const Lines<Float>& lines) {
  require(planes.size() == PLANE_PAIRS && lines.size() == PLANE_PAIRS,
          "planes: there are three planes and three lines");
  const std::size_t channels = planes[0].shape(2);
  require(channels >= 1 && channels <= convention::PLANES_MAX_CHANNELS, "planes: give 1 to 1024 channels");
  const auto nodes = [](std::size_t count) {
    require(count >= 2 && count <= convention::PLANES_MAX_SIDE, "planes: an axis has 2 to 4096 nodes");
    return static_cast<int>(count);
  };
  PlaneShape shape{static_cast<int>(channels), {}};
  for (int pair = 0; pair < PLANE_PAIRS; pair++) {
    require(planes[pair].shape(2) == channels && lines[pair].shape(1) == channels,
            "planes: planes [down across C] and lines [along C] must have the same channels");
    shape.pairs[pair] = {nodes(planes[pair].shape(1)), nodes(planes[pair].shape(0)), nodes(lines[pair].shape(0))};
  }
  return shape;
}

template <class Float>
PlaneGrids<Float> grids_of(const Planes<Float>& planes, const Lines<Float>& lines) {
  PlaneGrids<Float> grids;
  for (int pair = 0; pair < PLANE_PAIRS; pair++) {
    grids.planes[pair] = planes[pair].data();
    grids.lines[pair] = lines[pair].data();
  }
  return grids;
}

inline bool same(const PlaneShape& a, const PlaneShape& b) {
  bool equal = a.channels == b.channels;
  for (int pair = 0; pair < PLANE_PAIRS; pair++) {
    const PairSize &one = a.pairs[pair], &other = b.pairs[pair];
    equal = equal && one.across == other.across && one.down == other.down && one.along == other.along;
  }
  return equal;
}

}  // namespace ringlight
