// Which pixels the backward pass of a shader goes through, and how they are dealt out.
#pragma once
#include "reflection/packed_pixels.isa.hpp"
#include "reflection/pixels.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

// Lists the pixels that are opaque enough and have a gradient, that of rgb in `color`, and its sizes as ColorGradient
// has them. Returns how many these are; both lists have room for LANES more.
static inline std::size_t list_with_gradient(const ReflectionBuffers<const float>& from, float faintest,
                                      const ReflectionBuffers<float>& color, std::size_t blocks, std::int32_t* list,
                                      float* sizes) {
  std::size_t count = 0;
  IVec numbers = load_ints(NUMBERS);
  for (std::size_t block = 0; block < blocks; block++, numbers = numbers + ivec(LANES)) {
    unsigned on = bits(gt(load(from.alpha + block * from.block), Vec(faintest)));
    if (!on) continue;
    Vec size(0.f);
    for (int c = 0; c < 3; c++) size = size + abs(load(color.rgb + block * color.block + c * color.plane));
    on &= ~bits(both(ge(size, Vec(0.f)), ge(Vec(0.f), size)));  // what is no number is not 0
    store(sizes + count, pack_lanes(size, on));
    store(list + count, pack_lanes(numbers, on));
    count += __builtin_popcount(on);
  }
  return count;
}

// Shards: a power of two, so that two, four or eight threads have equal shares, and few for few pixels, because each
// holds sums as large as the parameters. A function of the number of pixels alone: the order of summation must not
// depend on the machine.
static inline int shard_count(std::size_t covered) {
  return covered <= 1024 ? 1 : covered <= 4096 ? 2 : covered <= 16384 ? 4 : 8;
}

// What a shard does: the drawn pixels from `begin` to `end`.
struct ShardRange {
  std::size_t begin, end;
};

// Ranges begin with a step: no two of them write to the same one.
static inline ShardRange range_of(const std::int32_t* drawn, std::size_t count, std::size_t shard,
                                  std::size_t shards) {
  const std::size_t each = (count + shards - 1) / shards;
  const auto start = [&](std::size_t at) {
    while (at && at < count && step_of(drawn[at]) == step_of(drawn[at - 1])) at++;
    return at < count ? at : count;
  };
  return {start(shard * each), start((shard + 1) * each)};
}

}  // namespace ringlight::RINGLIGHT_ISA
