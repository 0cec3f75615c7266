// Sines and cosines of features, for the network that makes colour.
#pragma once
#include "simd/simd.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

constexpr float LARGEST_REST = 0.7856f;  // a little above pi / 4

struct Wave {
  Vec sine, cosine;
};

// Both to about 2 ulp of one, for |x| up to some thousands; of larger ones they are at least between -1 and 1.
RINGLIGHT_INLINE Wave wave(Vec x) {
  static const float of_sine[] = {1.f, -1.6666654611e-1f, 8.3321608736e-3f, -1.9515295891e-4f};
  static const float of_cosine[] = {1.f, -0.5f, 4.166664568298827e-2f, -1.388731625493765e-3f, 2.443315711809948e-5f};
  const Vec quarter = round(x * Vec(0.636619772f));
  // pi / 2 in three parts, so that products with `quarter` are exact in the first two (Cody & Waite).
  const Vec reduced = fnma(quarter, Vec(7.54978995489e-8f), fnma(quarter, Vec(4.83751296997e-4f),
                                                                 fnma(quarter, Vec(1.5703125f), x)));
  const Vec rest = max(Vec(-LARGEST_REST), min(Vec(LARGEST_REST), reduced));
  const Vec square = rest * rest;
  const Vec sine = rest * polynomial(square, of_sine), cosine = polynomial(square, of_cosine);
  const Vec half = quarter * Vec(0.5f), turn = (half - floor(half)) * Vec(2.f);  // 0 or 1: odd quarters swap
  const Mask odd = gt(turn, Vec(0.5f));
  const Vec fourth = quarter * Vec(0.25f), place = (fourth - floor(fourth)) * Vec(4.f);  // 0, 1, 2 or 3
  const Vec s = select(odd, cosine, sine), c = select(odd, sine, cosine);
  const Mask minus_sine = gt(place, Vec(1.5f)), minus_cosine = both(gt(place, Vec(0.5f)), lt(place, Vec(2.5f)));
  return {select(minus_sine, -s, s), select(minus_cosine, -c, c)};
}

}  // namespace ringlight::RINGLIGHT_ISA
