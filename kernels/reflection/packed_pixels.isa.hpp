// Pixels of a picture, wherever they lie, side by side: what a plane holds at each of them in one row, and the way
// back. Planes are read and written one after another, which is what a processor foresees; group by group all of them
// would be more streams at once than it follows, and pixels that do not lie in a row would have to be gathered.
#pragma once
#include <cstring>

#include "dense/lane_panels.isa.hpp"
#include "machine/scratch.isa.hpp"
#include "raster/tiles.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

// Pixels packed at a time: few lanes of the last group are idle, and their planes fit the second cache.
constexpr int MOST_PACKED = 1024;
// Floats of a packed row: the last group of pixels is filled up, and whole Vecs are written.
constexpr std::size_t PACKED_ROW = MOST_PACKED + GROUP + LANES;

// Numbers of pixels, in order of memory. Those of sixteen neighbours in a plane make one step.
class PackedPixels {
 public:
  int count() const { return count_; }
  bool has_room() const { return count_ <= MOST_PACKED - LANES; }
  void clear() { count_ = steps_ = 0; }

  // Pixels `first` + i for every bit i of `on`, which are not none. To be asked has_room() before.
  void add(std::int32_t first, unsigned on) {
    first_[steps_] = first;
    on_[steps_++] = static_cast<std::uint16_t>(on);
    count_ += __builtin_popcount(on);
  }

  // Calls body(first, on, place), place being how many pixels come before.
  template <class F>
  __attribute__((always_inline)) void for_each_step(F&& body) const {
    for (int step = 0, place = 0; step < steps_; step++) {
      const unsigned on = on_[step];
      body(static_cast<std::size_t>(first_[step]), on, place);
      place += __builtin_popcount(on);
    }
  }

  // Where the step begins that comes `ahead` steps later, or the last one.
  std::size_t later(int step, int ahead) const {
    return static_cast<std::size_t>(first_[step + ahead < steps_ ? step + ahead : steps_ - 1]);
  }

 private:
  int count_ = 0, steps_ = 0;
  std::int32_t first_[MOST_PACKED];
  std::uint16_t on_[MOST_PACKED];
};

alignas(64) static const std::int32_t NUMBERS[LANES] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};

// The step of a plane of `size` numbers that begins at `first`; lanes beyond the plane's end are 0.
static inline Vec load_step(const float* plane, std::size_t first, std::size_t size) {
  const std::size_t left = size - first;
  return left >= LANES ? load(plane + first) : load_first(plane + first, static_cast<int>(left));
}

// The pixel with which the step of this one begins.
constexpr std::int32_t step_of(std::int32_t pixel) { return pixel / LANES * LANES; }

// Adds what comes next in an ascending list, until there is no room; returns where the list goes on.
static inline std::size_t add_listed(const std::int32_t* list, std::size_t begin, std::size_t end,
                                     PackedPixels& pixels) {
  while (begin < end && pixels.has_room()) {
    const std::int32_t first = step_of(list[begin]);
    unsigned on = 0;
    for (; begin < end && list[begin] < first + LANES; begin++) on |= 1u << (list[begin] - first);
    pixels.add(first, on);
  }
  return begin;
}

// Repeats the last pixel up to the end of its group: lanes that count for nothing must hold numbers.
static inline void fill_up(int count, float* row) {
  const Vec last(row[count - 1]);
  for (int place = count; place < (count + GROUP - 1) / GROUP * GROUP; place += LANES) store(row + place, last);
}

// What a plane of `size` numbers holds there. What comes next as a rule, the plane behind it, is asked for meanwhile.
static inline void pack(const float* plane, std::size_t size, const PackedPixels& pixels, float* row) {
  pixels.for_each_step([&](std::size_t first, unsigned on, int place) {
    __builtin_prefetch(plane + size + first);
    store(row + place, pack_lanes(load_step(plane, first, size), on));
  });
  fill_up(pixels.count(), row);
}

// The way back; what lies between the pixels is neither read nor written.
static inline void unpack(const float* row, const PackedPixels& pixels, float* plane) {
  pixels.for_each_step([&](std::size_t first, unsigned on, int place) {
    store_lanes(plane + first, expand_lanes(load(row + place), on), on);
  });
}

// Where the pixels of an image have their centres.
static inline void pack_centers(int width, const PackedPixels& pixels, float* x, float* y) {
  const Vec from_first = to_float(load_ints(NUMBERS));
  int row = 0;
  std::size_t row_start = 0;
  pixels.for_each_step([&](std::size_t first, unsigned on, int place) {
    if (first >= row_start + width) row = static_cast<int>(first / width), row_start = first - first % width;
    // Lanes beyond the row's end are at the start of one of the next rows.
    Vec column = Vec(static_cast<float>(first - row_start)) + from_first, line(static_cast<float>(row));
    for (std::size_t end = row_start + width; end < first + LANES; end += width) {
      const Mask beyond = ge(column, Vec(static_cast<float>(width)));
      column = column - keep(beyond, Vec(static_cast<float>(width)));
      line = line + keep(beyond, Vec(1.f));
    }
    store(x + place, pack_lanes(column + Vec(0.5f), on));
    store(y + place, pack_lanes(line + Vec(0.5f), on));
  });
  fill_up(pixels.count(), x);
  fill_up(pixels.count(), y);
}

// Where pixels that lie tile by tile have their centres.
static inline void pack_tile_centers(int width, const PackedPixels& pixels, float* x, float* y) {
  const std::size_t tiles_across = (width + convention::TILE - 1) / convention::TILE;
  pixels.for_each_step([&](std::size_t first, unsigned on, int place) {
    const std::size_t tile = first / TILE_PIXELS, block = first % TILE_PIXELS / LANES;
    const std::size_t left = tile % tiles_across * convention::TILE + block % BLOCKS_PER_SIDE * convention::BLOCK;
    const std::size_t top = tile / tiles_across * convention::TILE + block / BLOCKS_PER_SIDE * convention::BLOCK;
    store(x + place, pack_lanes(load(CENTERS_X) + Vec(static_cast<float>(left)), on));
    store(y + place, pack_lanes(load(CENTERS_Y) + Vec(static_cast<float>(top)), on));
  });
  fill_up(pixels.count(), x);
  fill_up(pixels.count(), y);
}

}  // namespace ringlight::RINGLIGHT_ISA
