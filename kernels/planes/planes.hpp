// A grid of three dimensions as planes times lines, linear in between (TensoRF, Chen et al. 2022, section 3;
// src/ringlight/fields/plane_products.py is the reference).
//
// Channels lie last, so that what is read and written around a point are runs of memory.
#pragma once
#include <cstddef>

#include "simd/dispatch.hpp"

namespace ringlight {

constexpr int PLANE_PAIRS = 3;  // a plane of the axes xy, xz, yz, and a line along z, y, x

struct PairSize {
  int across, down, along;  // nodes: of the plane's first and second axis, and of the line
};

struct PlaneShape {
  int channels;
  PairSize pairs[PLANE_PAIRS];
};

// By pair: plane [down across channels] and line [along channels]. Values, or where gradients go.
template <class Float>
struct PlaneGrids {
  Float *planes[PLANE_PAIRS], *lines[PLANE_PAIRS];
};

// Gradients of what products [N 3 channels] at points [N 3] pass back; points outside [-1, 1] are taken to the nearest.
#define RINGLIGHT_PLANES(isa) \
  namespace isa { \
  void plane_gradient(const PlaneShape&, const PlaneGrids<const float>&, std::size_t count, const float* points, \
                      const float* upstream, const PlaneGrids<float>& gradients); \
  }
RINGLIGHT_EVERY_ISA(RINGLIGHT_PLANES)
#undef RINGLIGHT_PLANES

}  // namespace ringlight
