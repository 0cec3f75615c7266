// The eight nodes around points, and the blocks that these lie in.
#include "machine/parallel.hpp"
#include "trains/trains.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

constexpr std::size_t POINTS = 4096;  // a piece

// Bits of a number below 2^10, with two zeros after each.
std::uint32_t spread(std::uint32_t x) {
  x = (x | x << 16) & 0x030000ffu;
  x = (x | x << 8) & 0x0300f00fu;
  x = (x | x << 4) & 0x030c30c3u;
  return (x | x << 2) & 0x09249249u;
}

// Along each axis the paths of the nodes before and after a point, and their shares.
struct Ends {
  std::uint32_t path[3][2];
  float share[3][2];

  Ends(const TrainPoints& points, std::size_t number) {
    const int side = 1 << points.levels;
    for (int axis = 0; axis < 3; axis++) {
      const float place = points.places[3 * number + axis];
      const float clamped = place > 0.f ? (place < 1.f ? place : 1.f) : 0.f;  // a NaN becomes 0
      const float at = clamped * static_cast<float>(side);
      const int low = static_cast<int>(at) < side - 1 ? static_cast<int>(at) : side - 1;
      const int high = low + 1 < side ? low + 1 : low;  // behind the last node there is its own value
      path[axis][0] = spread(static_cast<std::uint32_t>(low)) << (2 - axis);
      path[axis][1] = spread(static_cast<std::uint32_t>(high)) << (2 - axis);
      share[axis][1] = at - static_cast<float>(low);
      share[axis][0] = 1.f - share[axis][1];
    }
  }

  std::uint32_t corner(int number) const {
    return path[0][number >> 2] | path[1][number >> 1 & 1] | path[2][number & 1];
  }
  float part(int number) const {
    return share[0][number >> 2] * share[1][number >> 1 & 1] * share[2][number & 1];
  }

  // Calls body(block) for each block that has a corner, in the order of corners.
  template <class Body>
  void each_block(int bits, const Body& body) const {
    bool apart[3];
    for (int axis = 0; axis < 3; axis++) apart[axis] = path[axis][0] >> bits != path[axis][1] >> bits;
    for (int number = 0; number < TRAIN_CORNERS; number++) {
      const bool again = (number & 4 && !apart[0]) || (number & 2 && !apart[1]) || (number & 1 && !apart[2]);
      if (!again) body(corner(number) >> bits);
    }
  }
};

int bits_within(const TrainPoints& points) { return 3 * (points.levels - points.first); }

}  // namespace

void train_touch(const TrainPoints& points, std::int8_t* touched) {
  const int bits = bits_within(points);
  parallel_ranges(points.count, POINTS, [=](std::size_t begin, std::size_t end) {
    for (std::size_t number = begin; number < end; number++)
      Ends(points, number).each_block(bits, [=](std::uint32_t block) {
        // Whoever is first: all write the same.
        __atomic_store_n(touched + block, std::int8_t{1}, __ATOMIC_RELAXED);
      });
  });
}

void train_corners(const TrainPoints& points, const std::int32_t* slots, const TrainBags<std::int32_t, float>& bags) {
  const int bits = bits_within(points);
  const std::uint32_t within = (1u << bits) - 1;
  parallel_ranges(points.count, POINTS, [=](std::size_t begin, std::size_t end) {
    for (std::size_t number = begin; number < end; number++) {
      const Ends ends(points, number);
      for (int k = 0; k < TRAIN_CORNERS; k++) {
        const std::uint32_t path = ends.corner(k);
        const std::uint32_t slot = static_cast<std::uint32_t>(slots[path >> bits]);
        bags.index[TRAIN_CORNERS * number + k] = static_cast<std::int32_t>(slot << bits | (path & within));
        bags.shares[TRAIN_CORNERS * number + k] = ends.part(k);
      }
    }
  });
}

void train_count(const TrainPoints& points, const std::int32_t* slots, std::int64_t* counts) {
  const int bits = bits_within(points);
  for (std::size_t number = 0; number < points.count; number++)
    Ends(points, number).each_block(bits, [=](std::uint32_t block) { counts[slots[block]]++; });
}

// A point between blocks has a part in each; parts of one block follow each other in their points' order. `ends` are
// where blocks begin on entry, where they end on return.
void train_parts(const TrainPoints& points, const std::int32_t* slots, std::int64_t* ends, std::int32_t* owners,
                 const TrainBags<std::int32_t, float>& bags) {
  const int bits = bits_within(points);
  const std::uint32_t within = (1u << bits) - 1;
  for (std::size_t number = 0; number < points.count; number++) {
    const Ends of_point(points, number);
    of_point.each_block(bits, [&](std::uint32_t block) {
      const std::size_t part = static_cast<std::size_t>(ends[slots[block]]++);
      owners[part] = static_cast<std::int32_t>(number);
      for (int k = 0; k < TRAIN_CORNERS; k++) {
        const std::uint32_t path = of_point.corner(k);
        bags.index[TRAIN_CORNERS * part + k] = static_cast<std::int32_t>(path & within);
        bags.shares[TRAIN_CORNERS * part + k] = path >> bits == block ? of_point.part(k) : 0.f;
      }
    });
  }
}

}  // namespace ringlight::RINGLIGHT_ISA
