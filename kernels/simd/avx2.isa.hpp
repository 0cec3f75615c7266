// Vec over AVX2: two halves of eight lanes. Included by simd.isa.hpp only, which says what the functions mean.
#pragma once

namespace ringlight::RINGLIGHT_ISA {

// How many Vecs the register file holds.
constexpr int VEC_REGISTERS = 8;

struct Vec {
  __m256 low, high;
  Vec() = default;
  __attribute__((always_inline)) Vec(__m256 a, __m256 b) : low(a), high(b) {}
  __attribute__((always_inline)) Vec(float value) : low(_mm256_set1_ps(value)), high(low) {}
};
struct IVec {
  __m256i low, high;
};
struct Mask {
  __m256 low, high;  // all bits of a lane are set where it is on
};

// f(a), f(a, b) and f(a, b, c) by halves.
#define RINGLIGHT_HALVES1(Result, Operand, name, f) \
  RINGLIGHT_INLINE Result name(Operand a) { return {f(a.low), f(a.high)}; }
#define RINGLIGHT_HALVES2(Result, Operand, name, f) \
  RINGLIGHT_INLINE Result name(Operand a, Operand b) { return {f(a.low, b.low), f(a.high, b.high)}; }
#define RINGLIGHT_HALVES3(Result, Operand, name, f)                  \
  RINGLIGHT_INLINE Result name(Operand a, Operand b, Operand c) {    \
    return {f(a.low, b.low, c.low), f(a.high, b.high, c.high)};      \
  }
#define RINGLIGHT_COMPARE(name, relation)                                                                 \
  RINGLIGHT_INLINE Mask name(Vec a, Vec b) {                                                              \
    return {_mm256_cmp_ps(a.low, b.low, relation), _mm256_cmp_ps(a.high, b.high, relation)};              \
  }

namespace detail {
// All bits of lane i + 8 h are set where i + 8 h < count.
RINGLIGHT_INLINE __m256i first_lanes(int count, int half) {
  const __m256i lane = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
  return _mm256_cmpgt_epi32(_mm256_set1_epi32(count - 8 * half), lane);
}
}  // namespace detail

RINGLIGHT_INLINE Vec load(const float* from) { return {_mm256_loadu_ps(from), _mm256_loadu_ps(from + 8)}; }
RINGLIGHT_INLINE void store(float* to, Vec a) {
  _mm256_storeu_ps(to, a.low);
  _mm256_storeu_ps(to + 8, a.high);
}
// from[K .. K + 15]; the Vecs around it would take more to put together than a load.
template <int K>
RINGLIGHT_INLINE Vec load_shifted(const float* from, Vec, Vec, Vec) {
  return load(from + K);
}
// The first `count` floats (0..16); the remaining lanes are 0 and their memory is not touched.
RINGLIGHT_INLINE Vec load_first(const float* from, int count) {
  return {_mm256_maskload_ps(from, detail::first_lanes(count, 0)),
          _mm256_maskload_ps(from + 8, detail::first_lanes(count, 1))};
}
RINGLIGHT_INLINE void store_first(float* to, Vec a, int count) {
  _mm256_maskstore_ps(to, detail::first_lanes(count, 0), a.low);
  _mm256_maskstore_ps(to + 8, detail::first_lanes(count, 1), a.high);
}

RINGLIGHT_HALVES2(Vec, Vec, operator+, _mm256_add_ps)
RINGLIGHT_HALVES2(Vec, Vec, operator-, _mm256_sub_ps)
RINGLIGHT_HALVES2(Vec, Vec, operator*, _mm256_mul_ps)
RINGLIGHT_HALVES2(Vec, Vec, operator/, _mm256_div_ps)
RINGLIGHT_HALVES3(Vec, Vec, fma, _mm256_fmadd_ps)    // a b + c
RINGLIGHT_HALVES3(Vec, Vec, fnma, _mm256_fnmadd_ps)  // c - a b
RINGLIGHT_HALVES2(Vec, Vec, min, _mm256_min_ps)      // b where either is NaN
RINGLIGHT_HALVES2(Vec, Vec, max, _mm256_max_ps)      // b where either is NaN
RINGLIGHT_HALVES1(Vec, Vec, sqrt, _mm256_sqrt_ps)
RINGLIGHT_HALVES1(Vec, Vec, floor, _mm256_floor_ps)
RINGLIGHT_HALVES1(Vec, Vec, ceil, _mm256_ceil_ps)
namespace detail {
RINGLIGHT_INLINE __m256 round_half(__m256 a) {
  return _mm256_round_ps(a, _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC);
}
RINGLIGHT_INLINE __m256 abs_half(__m256 a) { return _mm256_andnot_ps(_mm256_set1_ps(-0.f), a); }
RINGLIGHT_INLINE __m256 reciprocal_half(__m256 a) {
  const __m256 guess = _mm256_rcp_ps(a);
  return _mm256_mul_ps(guess, _mm256_fnmadd_ps(a, guess, _mm256_set1_ps(2.f)));
}
}  // namespace detail
RINGLIGHT_HALVES1(Vec, Vec, round, detail::round_half)
RINGLIGHT_HALVES1(Vec, Vec, abs, detail::abs_half)
RINGLIGHT_HALVES1(Vec, Vec, reciprocal, detail::reciprocal_half)  // 1 / a to about 22 bits

RINGLIGHT_COMPARE(ge, _CMP_GE_OQ)
RINGLIGHT_COMPARE(gt, _CMP_GT_OQ)
RINGLIGHT_COMPARE(lt, _CMP_LT_OQ)
RINGLIGHT_HALVES2(Mask, Mask, both, _mm256_and_ps)
RINGLIGHT_INLINE bool any(Mask a) { return _mm256_movemask_ps(_mm256_or_ps(a.low, a.high)) != 0; }
RINGLIGHT_INLINE unsigned bits(Mask a) {  // lane i is bit i
  return static_cast<unsigned>(_mm256_movemask_ps(a.low) | _mm256_movemask_ps(a.high) << 8);
}
namespace detail {
RINGLIGHT_INLINE __m256 spread_bits(unsigned byte) {
  const __m256i bit = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
  const __m256i word = _mm256_set1_epi32(static_cast<int>(byte));
  return _mm256_castsi256_ps(_mm256_cmpeq_epi32(_mm256_and_si256(word, bit), bit));
}
}  // namespace detail
RINGLIGHT_INLINE Mask mask_from_bits(unsigned a) { return {detail::spread_bits(a), detail::spread_bits(a >> 8)}; }
RINGLIGHT_INLINE Vec select(Mask on, Vec a, Vec b) {
  return {_mm256_blendv_ps(b.low, a.low, on.low), _mm256_blendv_ps(b.high, a.high, on.high)};
}
RINGLIGHT_INLINE Vec keep(Mask on, Vec a) { return {_mm256_and_ps(on.low, a.low), _mm256_and_ps(on.high, a.high)}; }

RINGLIGHT_INLINE IVec ivec(int value) { return {_mm256_set1_epi32(value), _mm256_set1_epi32(value)}; }
RINGLIGHT_HALVES1(IVec, Vec, truncate, _mm256_cvttps_epi32)  // towards zero
RINGLIGHT_HALVES1(Vec, IVec, as_floats, _mm256_castsi256_ps)
RINGLIGHT_HALVES1(Vec, IVec, to_float, _mm256_cvtepi32_ps)
RINGLIGHT_HALVES2(IVec, IVec, operator+, _mm256_add_epi32)
RINGLIGHT_HALVES2(IVec, IVec, operator-, _mm256_sub_epi32)
RINGLIGHT_HALVES2(IVec, IVec, operator&, _mm256_and_si256)
RINGLIGHT_HALVES2(IVec, IVec, operator|, _mm256_or_si256)
RINGLIGHT_HALVES2(IVec, IVec, shift_left, _mm256_sllv_epi32)
RINGLIGHT_HALVES2(IVec, IVec, shift_right, _mm256_srlv_epi32)
template <int By>
RINGLIGHT_INLINE IVec shift_left(IVec a) {
  return {_mm256_slli_epi32(a.low, By), _mm256_slli_epi32(a.high, By)};
}
template <int By>
RINGLIGHT_INLINE IVec shift_right(IVec a) {
  return {_mm256_srli_epi32(a.low, By), _mm256_srli_epi32(a.high, By)};
}
RINGLIGHT_INLINE IVec select(Mask on, IVec a, IVec b) {
  return {_mm256_blendv_epi8(b.low, a.low, _mm256_castps_si256(on.low)),
          _mm256_blendv_epi8(b.high, a.high, _mm256_castps_si256(on.high))};
}
RINGLIGHT_INLINE IVec keep(Mask on, IVec a) {
  return {_mm256_and_si256(_mm256_castps_si256(on.low), a.low),
          _mm256_and_si256(_mm256_castps_si256(on.high), a.high)};
}
RINGLIGHT_INLINE void store(void* to, IVec a) {
  _mm256_storeu_si256(static_cast<__m256i*>(to), a.low);
  _mm256_storeu_si256(static_cast<__m256i*>(to) + 1, a.high);
}
RINGLIGHT_INLINE IVec load_ints(const void* from) {
  const auto* halves = static_cast<const __m256i*>(from);
  return {_mm256_loadu_si256(halves), _mm256_loadu_si256(halves + 1)};
}

// a 2^n for whole n, and the other way: a = mantissa 2^exponent with mantissa in [1, 2), for positive normal a.
// Here n is not checked: the result must be a normal number too.
namespace detail {
RINGLIGHT_INLINE __m256 scale_half(__m256 a, __m256 n) {
  const __m256i bits = _mm256_slli_epi32(_mm256_cvtps_epi32(n), 23);
  return _mm256_castsi256_ps(_mm256_add_epi32(_mm256_castps_si256(a), bits));
}
RINGLIGHT_INLINE __m256 exponent_half(__m256 a) {
  const __m256i biased = _mm256_srli_epi32(_mm256_castps_si256(a), 23);
  return _mm256_cvtepi32_ps(_mm256_sub_epi32(biased, _mm256_set1_epi32(127)));
}
RINGLIGHT_INLINE __m256 mantissa_half(__m256 a) {
  const __m256 fraction = _mm256_and_ps(a, _mm256_castsi256_ps(_mm256_set1_epi32(0x007fffff)));
  return _mm256_or_ps(fraction, _mm256_set1_ps(1.f));
}
}  // namespace detail
RINGLIGHT_HALVES2(Vec, Vec, scale_by_power, detail::scale_half)
// x - floor(x), and a 2^floor(x).
RINGLIGHT_INLINE Vec fraction(Vec x) { return x - floor(x); }
RINGLIGHT_INLINE Vec scale_by_floor(Vec a, Vec x) { return scale_by_power(a, floor(x)); }
RINGLIGHT_HALVES1(Vec, Vec, exponent, detail::exponent_half)
RINGLIGHT_HALVES1(Vec, Vec, mantissa, detail::mantissa_half)

// Quarter j (four lanes) of rows[i] becomes quarter i of rows[j].
RINGLIGHT_INLINE void transpose_quarters(Vec rows[4]) {
  const Vec r0 = rows[0], r1 = rows[1], r2 = rows[2], r3 = rows[3];
  rows[0] = {_mm256_permute2f128_ps(r0.low, r1.low, 0x20), _mm256_permute2f128_ps(r2.low, r3.low, 0x20)};
  rows[1] = {_mm256_permute2f128_ps(r0.low, r1.low, 0x31), _mm256_permute2f128_ps(r2.low, r3.low, 0x31)};
  rows[2] = {_mm256_permute2f128_ps(r0.high, r1.high, 0x20), _mm256_permute2f128_ps(r2.high, r3.high, 0x20)};
  rows[3] = {_mm256_permute2f128_ps(r0.high, r1.high, 0x31), _mm256_permute2f128_ps(r2.high, r3.high, 0x31)};
}

namespace detail {
RINGLIGHT_INLINE void transpose8(__m256 rows[8]) {
  __m256 pairs[8], quads[8];
  for (int i = 0; i < 4; i++) {
    pairs[2 * i] = _mm256_unpacklo_ps(rows[2 * i], rows[2 * i + 1]);
    pairs[2 * i + 1] = _mm256_unpackhi_ps(rows[2 * i], rows[2 * i + 1]);
  }
  for (int i = 0; i < 8; i += 4)
    for (int half = 0; half < 2; half++) {
      quads[i + 2 * half] = _mm256_shuffle_ps(pairs[i + half], pairs[i + half + 2], 0x44);
      quads[i + 2 * half + 1] = _mm256_shuffle_ps(pairs[i + half], pairs[i + half + 2], 0xee);
    }
  for (int j = 0; j < 4; j++) {
    rows[j] = _mm256_permute2f128_ps(quads[j], quads[4 + j], 0x20);
    rows[4 + j] = _mm256_permute2f128_ps(quads[j], quads[4 + j], 0x31);
  }
}
}  // namespace detail

// rows[i] lane j becomes rows[j] lane i.
RINGLIGHT_INLINE void transpose(Vec rows[16]) {
  __m256 quarter[2][2][8];  // [rows 0-7 or 8-15][lanes 0-7 or 8-15]
  for (int i = 0; i < 16; i++) {
    quarter[i / 8][0][i % 8] = rows[i].low;
    quarter[i / 8][1][i % 8] = rows[i].high;
  }
  for (int i = 0; i < 2; i++)
    for (int j = 0; j < 2; j++) detail::transpose8(quarter[i][j]);
  for (int i = 0; i < 16; i++) rows[i] = {quarter[0][i / 8][i % 8], quarter[1][i / 8][i % 8]};
}

// Sixteen rows of eight floats as eight columns, and back, in half the time of rows of any width; true, for it is done.
RINGLIGHT_INLINE bool load_eights(const float* rows, Vec* columns) {
  __m256 upper[8], lower[8];
  for (int i = 0; i < 8; i++) upper[i] = _mm256_loadu_ps(rows + 8 * i), lower[i] = _mm256_loadu_ps(rows + 64 + 8 * i);
  detail::transpose8(upper);
  detail::transpose8(lower);
  for (int i = 0; i < 8; i++) columns[i] = {upper[i], lower[i]};
  return true;
}
RINGLIGHT_INLINE bool store_eights(float* rows, const Vec* columns) {
  __m256 upper[8], lower[8];
  for (int i = 0; i < 8; i++) upper[i] = columns[i].low, lower[i] = columns[i].high;
  detail::transpose8(upper);
  detail::transpose8(lower);
  for (int i = 0; i < 8; i++) _mm256_storeu_ps(rows + 8 * i, upper[i]), _mm256_storeu_ps(rows + 64 + 8 * i, lower[i]);
  return true;
}

// Lane i holds the sum of the lanes of terms[i]; lanes from Count on are 0. Count <= 16.
template <int Count>
RINGLIGHT_INLINE Vec lane_sums(const Vec* terms) {
  const __m256 zero = _mm256_setzero_ps();
  __m128 fours[4];
#pragma GCC unroll 4
  for (int i = 0; i < 4; i++) {
    __m256 halves[4];
#pragma GCC unroll 4
    for (int k = 0; k < 4; k++) {
      const int term = 4 * i + k < Count ? 4 * i + k : 0;
      halves[k] = 4 * i + k < Count ? _mm256_add_ps(terms[term].low, terms[term].high) : zero;
    }
    const __m256 sums = _mm256_hadd_ps(_mm256_hadd_ps(halves[0], halves[1]), _mm256_hadd_ps(halves[2], halves[3]));
    fours[i] = _mm_add_ps(_mm256_castps256_ps128(sums), _mm256_extractf128_ps(sums, 1));
  }
  return {_mm256_set_m128(fours[1], fours[0]), _mm256_set_m128(fours[3], fours[2])};
}
RINGLIGHT_INLINE float sum(Vec a) {
  const __m256 eight = _mm256_add_ps(a.low, a.high);
  const __m128 four = _mm_add_ps(_mm256_castps256_ps128(eight), _mm256_extractf128_ps(eight, 1));
  const __m128 two = _mm_add_ps(four, _mm_movehl_ps(four, four));
  return _mm_cvtss_f32(_mm_add_ss(two, _mm_movehdup_ps(two)));
}

// Sixteen 64-bit words from their low and high halves.
RINGLIGHT_INLINE void store_words(std::uint64_t* to, IVec low, IVec high) {
  const __m256i lows[2] = {low.low, low.high}, highs[2] = {high.low, high.high};
  for (int i = 0; i < 2; i++) {
    const __m256i even = _mm256_unpacklo_epi32(lows[i], highs[i]), odd = _mm256_unpackhi_epi32(lows[i], highs[i]);
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(to + 8 * i), _mm256_permute2x128_si256(even, odd, 0x20));
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(to + 8 * i + 4), _mm256_permute2x128_si256(even, odd, 0x31));
  }
}

#undef RINGLIGHT_HALVES1
#undef RINGLIGHT_HALVES2
#undef RINGLIGHT_HALVES3
#undef RINGLIGHT_COMPARE

}  // namespace ringlight::RINGLIGHT_ISA
