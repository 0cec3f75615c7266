// Rows and columns, words and bits, in plain C++: for instruction sets without instructions of their own for it.
// Included by simd.isa.hpp only, which says what the functions mean.
#pragma once

namespace ringlight::RINGLIGHT_ISA {

constexpr unsigned ALL_LANES = 0xffff;

namespace detail {
// Columns to rows through memory, and back: the compiler turns the fixed loops into shuffles. The rows may be records
// of other types than float, as with intrinsics.
using AnyFloat = float __attribute__((may_alias));
template <int Columns>
RINGLIGHT_INLINE void interleave(float* rows, const Vec* columns) {
  AnyFloat* const to = rows;
  alignas(32) float lanes[Columns][16];
  for (int c = 0; c < Columns; c++) store(lanes[c], columns[c]);
  for (int i = 0; i < 16; i++)
    for (int c = 0; c < Columns; c++) to[Columns * i + c] = lanes[c][i];
}
template <int Columns>
RINGLIGHT_INLINE void deinterleave(const float* from, Vec* columns) {
  alignas(32) float lanes[Columns][16];
  for (int i = 0; i < 16; i++)
    for (int c = 0; c < Columns; c++) lanes[c][i] = from[Columns * i + c];
  for (int c = 0; c < Columns; c++) columns[c] = load(lanes[c]);
}
}  // namespace detail

// Four floats from each of four places, side by side.
RINGLIGHT_INLINE Vec load_quarters(const float* a, const float* b, const float* c, const float* d) {
  alignas(32) float lanes[16];
  const float* const from[] = {a, b, c, d};
  for (int i = 0; i < 4; i++) __builtin_memcpy(lanes + 4 * i, from[i], 4 * sizeof(float));
  return load(lanes);
}
// Quarter i holds lane 4 Quarter + i four times.
template <int Quarter>
RINGLIGHT_INLINE Vec repeat_quarter(Vec a) {
  alignas(32) float lanes[16], spread[16];
  store(lanes, a);
  for (int i = 0; i < 16; i++) spread[i] = lanes[4 * Quarter + i / 4];
  return load(spread);
}

// The lanes whose bits are on, side by side, and the way back; other lanes are 0. All of them are the usual case.
RINGLIGHT_INLINE Vec pack_lanes(Vec a, unsigned on) {
  if (on == ALL_LANES) return a;
  alignas(32) float lanes[16], packed[16] = {};
  store(lanes, a);
  for (int count = 0; on; on &= on - 1) packed[count++] = lanes[__builtin_ctz(on)];
  return load(packed);
}
RINGLIGHT_INLINE IVec pack_lanes(IVec a, unsigned on) {
  if (on == ALL_LANES) return a;
  alignas(32) std::int32_t lanes[16], packed[16] = {};
  store(lanes, a);
  for (int count = 0; on; on &= on - 1) packed[count++] = lanes[__builtin_ctz(on)];
  return load_ints(packed);
}
RINGLIGHT_INLINE Vec expand_lanes(Vec a, unsigned on) {
  if (on == ALL_LANES) return a;
  alignas(32) float lanes[16] = {}, packed[16];
  store(packed, a);
  for (int count = 0; on; on &= on - 1) lanes[__builtin_ctz(on)] = packed[count++];
  return load(lanes);
}
// The lanes whose bits are on; the memory of others is not touched.
RINGLIGHT_INLINE void store_lanes(float* to, Vec a, unsigned on) {
  if (on == ALL_LANES) return store(to, a);
  alignas(32) float lanes[16];
  store(lanes, a);
  for (; on; on &= on - 1) to[__builtin_ctz(on)] = lanes[__builtin_ctz(on)];
}

// Sixteen rows of 3 (4) floats, row after row in memory, as 3 (4) columns.
RINGLIGHT_INLINE void load_columns(const float* from, Vec& a, Vec& b, Vec& c) {
  Vec columns[3];
  detail::deinterleave<3>(from, columns);
  a = columns[0], b = columns[1], c = columns[2];
}
RINGLIGHT_INLINE void load_columns(const float* from, Vec& a, Vec& b, Vec& c, Vec& d) {
  Vec columns[4];
  detail::deinterleave<4>(from, columns);
  a = columns[0], b = columns[1], c = columns[2], d = columns[3];
}
// The way back: columns to rows of 2 (3, 4) floats.
RINGLIGHT_INLINE void store_columns(float* to, Vec a, Vec b) {
  const Vec columns[2] = {a, b};
  detail::interleave<2>(to, columns);
}
RINGLIGHT_INLINE void store_columns(float* to, Vec a, Vec b, Vec c) {
  const Vec columns[3] = {a, b, c};
  detail::interleave<3>(to, columns);
}
RINGLIGHT_INLINE void store_columns(float* to, Vec a, Vec b, Vec c, Vec d) {
  const Vec columns[4] = {a, b, c, d};
  detail::interleave<4>(to, columns);
}
// Bit j of words[i] becomes bit i of words[j]: swap ever smaller off-diagonal squares (Hacker's Delight 7-3).
RINGLIGHT_INLINE void transpose_bits(std::uint64_t words[64]) {
  std::uint64_t mask = 0x00000000ffffffffull;
  for (int size = 32; size; size >>= 1, mask ^= mask << size)
    for (int k = 0; k < 64; k = ((k | size) + 1) & ~size) {
      const std::uint64_t swap = ((words[k] >> size) ^ words[k + size]) & mask;
      words[k] ^= swap << size;
      words[k + size] ^= swap;
    }
}

// Writes first + (number of each set bit), ascending; returns how many. Up to 64 bytes from `to` may be overwritten.
RINGLIGHT_INLINE int list_set_bits(std::uint64_t word, int first, std::uint8_t* to) {
  int count = 0;
  for (; word; word &= word - 1) to[count++] = static_cast<std::uint8_t>(first + __builtin_ctzll(word));
  return count;
}

}  // namespace ringlight::RINGLIGHT_ISA
