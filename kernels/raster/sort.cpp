// Least-significant-digit radix sort, stable and parallel. Keys are counted from the nearest one, so that the bits
// which all keys share cost no pass: two passes of 11 or 12 bits for the usual scene.
#include "raster/sort.hpp"

#include <algorithm>
#include <bit>
#include <utility>

#include "machine/parallel.hpp"

namespace ringlight {
namespace {

constexpr int MAX_DIGIT_BITS = 12;  // 4096 counters of 4 bytes stay in L1

struct KeyRange {
  std::uint32_t nearest = NOT_DRAWN, farthest = 0;
};

KeyRange range_of(const View& view) {
  KeyRange range;
  const std::size_t pieces = (view.splats.count + ROWS_PER_PIECE - 1) / ROWS_PER_PIECE;
  for (std::size_t i = 0; i < pieces; i++) {
    range.nearest = std::min(range.nearest, view.pieces[i].nearest);
    range.farthest = std::max(range.farthest, view.pieces[i].farthest);
  }
  return range;
}

// One digit of the sort. Items are cut into one segment per worker; a segment's items of equal digit stay in order
// and follow those of earlier segments, so the result does not depend on the number of segments.
struct Pass {
  std::size_t count, segments;
  int shift, bits;
  std::uint32_t* counts;

  std::size_t begin(std::size_t segment) const { return count * segment / segments; }
  std::uint32_t* digits(std::size_t segment) const { return counts + (segment << bits); }
  std::uint32_t digit(std::uint64_t key) const { return static_cast<std::uint32_t>(key >> shift) & ((1u << bits) - 1); }

  template <class Visit>  // visit(item, f) calls f(key, value) unless the item is to be dropped
  void run(std::uint64_t* to, Visit&& visit) const {
    parallel_for(segments, [&](std::size_t s) {
      std::uint32_t* const mine = digits(s);
      std::fill(mine, mine + (std::size_t{1} << bits), 0u);
      for (std::size_t i = begin(s); i < begin(s + 1); i++)
        visit(i, [&](std::uint64_t key, std::uint64_t) { mine[digit(key)]++; });
    });
    std::uint32_t sum = 0;
    for (std::size_t d = 0; d < std::size_t{1} << bits; d++)
      for (std::size_t s = 0; s < segments; s++) sum += std::exchange(digits(s)[d], sum);
    parallel_for(segments, [&](std::size_t s) {
      std::uint32_t* const mine = digits(s);
      for (std::size_t i = begin(s); i < begin(s + 1); i++)
        visit(i, [&](std::uint64_t key, std::uint64_t value) { to[mine[digit(key)]++] = value; });
    });
  }
};

}  // namespace

const std::uint64_t* DepthSort::sort(const View& view, std::size_t drawn) {
  if (drawn == 0) return nullptr;
  const KeyRange range = range_of(view);
  const int key_bits = std::max(1, static_cast<int>(std::bit_width(range.farthest - range.nearest)));
  const int passes = (key_bits + MAX_DIGIT_BITS - 1) / MAX_DIGIT_BITS;
  const int bits = (key_bits + passes - 1) / passes;
  const std::size_t segments = static_cast<std::size_t>(view.workers);
  std::uint32_t* const counts = counts_.reserve(segments << bits);
  std::uint64_t* from = pairs_.reserve(drawn);
  std::uint64_t* to = sorted_.reserve(drawn);

  const Placement* const placements = view.placements;
  Pass{view.splats.count, segments, 0, bits, counts}.run(to, [&](std::size_t row, auto&& f) {
    const std::uint32_t key = placements[row].depth_key;
    if (key != NOT_DRAWN) f(key - range.nearest, std::uint64_t{key - range.nearest} << 32 | row);
  });
  for (int pass = 1; pass < passes; pass++) {
    std::swap(from, to);
    Pass{drawn, segments, 32 + pass * bits, bits, counts}.run(
        to, [&](std::size_t i, auto&& f) { f(from[i], from[i]); });
  }
  return to;
}

}  // namespace ringlight
