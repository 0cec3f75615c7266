// Vec over AVX-512 (with VBMI2, BITALG, VNNI and GFNI). Included by simd.isa.hpp only, which says what functions mean.
#pragma once

namespace ringlight::RINGLIGHT_ISA {

// How many Vecs the register file holds.
constexpr int VEC_REGISTERS = 32;

struct Vec {
  __m512 v;
  Vec() = default;
  __attribute__((always_inline)) Vec(__m512 lanes) : v(lanes) {}
  __attribute__((always_inline)) Vec(float value) : v(_mm512_set1_ps(value)) {}
};
struct IVec {
  __m512i v;
};
using Mask = __mmask16;

RINGLIGHT_INLINE Vec load(const float* from) { return _mm512_loadu_ps(from); }
RINGLIGHT_INLINE void store(float* to, Vec a) { _mm512_storeu_ps(to, a.v); }
// from[K .. K + 15] of an aligned `from`, whose own sixteen, those before and those after are at hand: a load that
// crosses a cache line takes twice as long as putting it together.
template <int K>
RINGLIGHT_INLINE Vec load_shifted(const float*, Vec before, Vec own, Vec after) {
  const __m512i a = _mm512_castps_si512(K < 0 ? before.v : own.v), b = _mm512_castps_si512(K < 0 ? own.v : after.v);
  return _mm512_castsi512_ps(_mm512_alignr_epi32(b, a, K < 0 ? 16 + K : K));
}
// The first `count` floats (0..16); the remaining lanes are 0 and their memory is not touched.
RINGLIGHT_INLINE Vec load_first(const float* from, int count) {
  return _mm512_maskz_loadu_ps(static_cast<Mask>((1u << count) - 1), from);
}
RINGLIGHT_INLINE void store_first(float* to, Vec a, int count) {
  _mm512_mask_storeu_ps(to, static_cast<Mask>((1u << count) - 1), a.v);
}

RINGLIGHT_INLINE Vec operator+(Vec a, Vec b) { return _mm512_add_ps(a.v, b.v); }
RINGLIGHT_INLINE Vec operator-(Vec a, Vec b) { return _mm512_sub_ps(a.v, b.v); }
RINGLIGHT_INLINE Vec operator*(Vec a, Vec b) { return _mm512_mul_ps(a.v, b.v); }
RINGLIGHT_INLINE Vec operator/(Vec a, Vec b) { return _mm512_div_ps(a.v, b.v); }
RINGLIGHT_INLINE Vec fma(Vec a, Vec b, Vec c) { return _mm512_fmadd_ps(a.v, b.v, c.v); }    // a b + c
RINGLIGHT_INLINE Vec fnma(Vec a, Vec b, Vec c) { return _mm512_fnmadd_ps(a.v, b.v, c.v); }  // c - a b
RINGLIGHT_INLINE Vec min(Vec a, Vec b) { return _mm512_min_ps(a.v, b.v); }  // b where either is NaN
RINGLIGHT_INLINE Vec max(Vec a, Vec b) { return _mm512_max_ps(a.v, b.v); }  // b where either is NaN
RINGLIGHT_INLINE Vec sqrt(Vec a) { return _mm512_sqrt_ps(a.v); }
RINGLIGHT_INLINE Vec abs(Vec a) { return _mm512_abs_ps(a.v); }
RINGLIGHT_INLINE Vec floor(Vec a) { return _mm512_roundscale_ps(a.v, _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC); }
RINGLIGHT_INLINE Vec ceil(Vec a) { return _mm512_roundscale_ps(a.v, _MM_FROUND_TO_POS_INF | _MM_FROUND_NO_EXC); }
RINGLIGHT_INLINE Vec round(Vec a) { return _mm512_roundscale_ps(a.v, _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC); }
// 1 / a to about 23 bits, several times faster than a division.
RINGLIGHT_INLINE Vec reciprocal(Vec a) {
  const __m512 guess = _mm512_rcp14_ps(a.v);
  return _mm512_mul_ps(guess, _mm512_fnmadd_ps(a.v, guess, _mm512_set1_ps(2.f)));
}

RINGLIGHT_INLINE Mask ge(Vec a, Vec b) { return _mm512_cmp_ps_mask(a.v, b.v, _CMP_GE_OQ); }
RINGLIGHT_INLINE Mask gt(Vec a, Vec b) { return _mm512_cmp_ps_mask(a.v, b.v, _CMP_GT_OQ); }
RINGLIGHT_INLINE Mask lt(Vec a, Vec b) { return _mm512_cmp_ps_mask(a.v, b.v, _CMP_LT_OQ); }
RINGLIGHT_INLINE Mask both(Mask a, Mask b) { return a & b; }
RINGLIGHT_INLINE bool any(Mask a) { return a != 0; }
RINGLIGHT_INLINE unsigned bits(Mask a) { return a; }  // lane i is bit i
RINGLIGHT_INLINE Mask mask_from_bits(unsigned a) { return static_cast<Mask>(a); }
RINGLIGHT_INLINE Vec select(Mask on, Vec a, Vec b) { return _mm512_mask_blend_ps(on, b.v, a.v); }
RINGLIGHT_INLINE Vec keep(Mask on, Vec a) { return _mm512_maskz_mov_ps(on, a.v); }

RINGLIGHT_INLINE IVec ivec(int value) { return {_mm512_set1_epi32(value)}; }
RINGLIGHT_INLINE IVec truncate(Vec a) { return {_mm512_cvttps_epi32(a.v)}; }  // towards zero
RINGLIGHT_INLINE Vec as_floats(IVec a) { return _mm512_castsi512_ps(a.v); }
RINGLIGHT_INLINE Vec to_float(IVec a) { return _mm512_cvtepi32_ps(a.v); }
RINGLIGHT_INLINE IVec operator+(IVec a, IVec b) { return {_mm512_add_epi32(a.v, b.v)}; }
RINGLIGHT_INLINE IVec operator-(IVec a, IVec b) { return {_mm512_sub_epi32(a.v, b.v)}; }
RINGLIGHT_INLINE IVec operator&(IVec a, IVec b) { return {_mm512_and_si512(a.v, b.v)}; }
RINGLIGHT_INLINE IVec operator|(IVec a, IVec b) { return {_mm512_or_si512(a.v, b.v)}; }
RINGLIGHT_INLINE IVec shift_left(IVec a, IVec by) { return {_mm512_sllv_epi32(a.v, by.v)}; }
RINGLIGHT_INLINE IVec shift_right(IVec a, IVec by) { return {_mm512_srlv_epi32(a.v, by.v)}; }
template <int By>
RINGLIGHT_INLINE IVec shift_left(IVec a) {
  return {_mm512_slli_epi32(a.v, By)};
}
template <int By>
RINGLIGHT_INLINE IVec shift_right(IVec a) {
  return {_mm512_srli_epi32(a.v, By)};
}
RINGLIGHT_INLINE IVec select(Mask on, IVec a, IVec b) { return {_mm512_mask_blend_epi32(on, b.v, a.v)}; }
RINGLIGHT_INLINE IVec keep(Mask on, IVec a) { return {_mm512_maskz_mov_epi32(on, a.v)}; }
RINGLIGHT_INLINE void store(void* to, IVec a) { _mm512_storeu_si512(to, a.v); }
RINGLIGHT_INLINE IVec load_ints(const void* from) { return {_mm512_loadu_si512(from)}; }
// The lanes whose bits are on, side by side, and the way back; other lanes are 0.
RINGLIGHT_INLINE Vec pack_lanes(Vec a, unsigned on) { return _mm512_maskz_compress_ps(static_cast<Mask>(on), a.v); }
RINGLIGHT_INLINE IVec pack_lanes(IVec a, unsigned on) {
  return {_mm512_maskz_compress_epi32(static_cast<Mask>(on), a.v)};
}
RINGLIGHT_INLINE Vec expand_lanes(Vec a, unsigned on) { return _mm512_maskz_expand_ps(static_cast<Mask>(on), a.v); }
// The lanes whose bits are on; the memory of others is not touched.
RINGLIGHT_INLINE void store_lanes(float* to, Vec a, unsigned on) {
  _mm512_mask_storeu_ps(to, static_cast<Mask>(on), a.v);
}

// a 2^n for whole n, and the other way: a = mantissa 2^exponent with mantissa in [1, 2), for positive normal a.
RINGLIGHT_INLINE Vec scale_by_power(Vec a, Vec n) { return _mm512_scalef_ps(a.v, n.v); }
// x - floor(x), and a 2^floor(x).
RINGLIGHT_INLINE Vec fraction(Vec x) { return _mm512_reduce_ps(x.v, _MM_FROUND_TO_NEG_INF); }
RINGLIGHT_INLINE Vec scale_by_floor(Vec a, Vec x) { return _mm512_scalef_ps(a.v, x.v); }
RINGLIGHT_INLINE Vec exponent(Vec a) { return _mm512_getexp_ps(a.v); }
RINGLIGHT_INLINE Vec mantissa(Vec a) { return _mm512_getmant_ps(a.v, _MM_MANT_NORM_1_2, _MM_MANT_SIGN_src); }

// Quarter j (four lanes) of rows[i] becomes quarter i of rows[j].
RINGLIGHT_INLINE void transpose_quarters(Vec rows[4]) {
  const __m512 low01 = _mm512_shuffle_f32x4(rows[0].v, rows[1].v, 0x44);
  const __m512 low23 = _mm512_shuffle_f32x4(rows[2].v, rows[3].v, 0x44);
  const __m512 high01 = _mm512_shuffle_f32x4(rows[0].v, rows[1].v, 0xee);
  const __m512 high23 = _mm512_shuffle_f32x4(rows[2].v, rows[3].v, 0xee);
  rows[0] = _mm512_shuffle_f32x4(low01, low23, 0x88);
  rows[1] = _mm512_shuffle_f32x4(low01, low23, 0xdd);
  rows[2] = _mm512_shuffle_f32x4(high01, high23, 0x88);
  rows[3] = _mm512_shuffle_f32x4(high01, high23, 0xdd);
}

// Four floats from each of four places, side by side.
RINGLIGHT_INLINE Vec load_quarters(const float* a, const float* b, const float* c, const float* d) {
  const __m256 low = _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(a)), _mm_loadu_ps(b), 1);
  const __m256 high = _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(c)), _mm_loadu_ps(d), 1);
  return _mm512_insertf32x8(_mm512_castps256_ps512(low), high, 1);
}
// Quarter i holds lane 4 Quarter + i four times.
template <int Quarter>
RINGLIGHT_INLINE Vec repeat_quarter(Vec a) {
  const __m512i lanes = _mm512_setr_epi32(0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3);
  return _mm512_permutexvar_ps(_mm512_add_epi32(lanes, _mm512_set1_epi32(4 * Quarter)), a.v);
}

// rows[i] lane j becomes rows[j] lane i.
RINGLIGHT_INLINE void transpose(Vec rows[16]) {
  __m512 pairs[16], quads[16];
  for (int i = 0; i < 8; i++) {
    pairs[2 * i] = _mm512_unpacklo_ps(rows[2 * i].v, rows[2 * i + 1].v);
    pairs[2 * i + 1] = _mm512_unpackhi_ps(rows[2 * i].v, rows[2 * i + 1].v);
  }
  for (int i = 0; i < 16; i += 4)
    for (int half = 0; half < 2; half++) {
      const __m512d a = _mm512_castps_pd(pairs[i + half]), b = _mm512_castps_pd(pairs[i + half + 2]);
      quads[i + 2 * half] = _mm512_castpd_ps(_mm512_unpacklo_pd(a, b));
      quads[i + 2 * half + 1] = _mm512_castpd_ps(_mm512_unpackhi_pd(a, b));
    }
  for (int j = 0; j < 4; j++) {
    const __m512 even_low = _mm512_shuffle_f32x4(quads[j], quads[4 + j], 0x88);
    const __m512 odd_low = _mm512_shuffle_f32x4(quads[j], quads[4 + j], 0xdd);
    const __m512 even_high = _mm512_shuffle_f32x4(quads[8 + j], quads[12 + j], 0x88);
    const __m512 odd_high = _mm512_shuffle_f32x4(quads[8 + j], quads[12 + j], 0xdd);
    rows[j] = _mm512_shuffle_f32x4(even_low, even_high, 0x88);
    rows[4 + j] = _mm512_shuffle_f32x4(odd_low, odd_high, 0x88);
    rows[8 + j] = _mm512_shuffle_f32x4(even_low, even_high, 0xdd);
    rows[12 + j] = _mm512_shuffle_f32x4(odd_low, odd_high, 0xdd);
  }
}

// No way of its own with sixteen rows of eight floats.
RINGLIGHT_INLINE bool load_eights(const float*, Vec*) { return false; }
RINGLIGHT_INLINE bool store_eights(float*, const Vec*) { return false; }

namespace detail {
RINGLIGHT_INLINE __m512 add_neighbours(__m512 a, __m512 b) {
  return _mm512_add_ps(_mm512_unpacklo_ps(a, b), _mm512_unpackhi_ps(a, b));
}
RINGLIGHT_INLINE __m512 add_pairs(__m512 a, __m512 b) {
  const __m512d x = _mm512_castps_pd(a), y = _mm512_castps_pd(b);
  return _mm512_add_ps(_mm512_castpd_ps(_mm512_unpacklo_pd(x, y)), _mm512_castpd_ps(_mm512_unpackhi_pd(x, y)));
}
RINGLIGHT_INLINE __m512 add_quarters(__m512 a, __m512 b) {
  return _mm512_add_ps(_mm512_shuffle_f32x4(a, b, 0x88), _mm512_shuffle_f32x4(a, b, 0xdd));
}
}  // namespace detail

// Lane i holds the sum of the lanes of terms[i]; lanes from Count on are 0. Count <= 16.
template <int Count>
RINGLIGHT_INLINE Vec lane_sums(const Vec* terms) {
  const __m512 zero = _mm512_setzero_ps();
  __m512 fours[4];
#pragma GCC unroll 4
  for (int i = 0; i < 4; i++) {
    const int k = 4 * i;
    if (k >= Count) {
      fours[i] = zero;
      continue;
    }
    const __m512 b = k + 1 < Count ? terms[k + 1].v : zero;
    const __m512 c = k + 2 < Count ? terms[k + 2].v : zero;
    const __m512 d = k + 3 < Count ? terms[k + 3].v : zero;
    const __m512 low = detail::add_neighbours(terms[k].v, b);
    fours[i] = detail::add_pairs(low, k + 2 < Count ? detail::add_neighbours(c, d) : zero);
  }
  const __m512 low = detail::add_quarters(fours[0], fours[1]);
  return detail::add_quarters(low, Count > 8 ? detail::add_quarters(fours[2], fours[3]) : zero);
}
RINGLIGHT_INLINE float sum(Vec a) { return _mm512_reduce_add_ps(a.v); }

namespace detail {
// The lane numbers that pick every `stride`-th element out of two registers, starting at `first`.
RINGLIGHT_INLINE __m512i every(int first, int stride) {
  const __m512i lane = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
  return _mm512_add_epi32(_mm512_mullo_epi32(lane, _mm512_set1_epi32(stride)), _mm512_set1_epi32(first));
}
}  // namespace detail

// Sixteen rows of 3 (4) floats, row after row in memory, as 3 (4) columns.
RINGLIGHT_INLINE void load_columns(const float* from, Vec& a, Vec& b, Vec& c) {
  const __m512 x = _mm512_loadu_ps(from), y = _mm512_loadu_ps(from + 16), z = _mm512_loadu_ps(from + 32);
  Vec* const columns[3] = {&a, &b, &c};
#pragma GCC unroll 3
  for (int k = 0; k < 3; k++) {
    // Element 3 i + k: from x and y while it is below 32, then from z (whose element 0 is number 32).
    const __m512i index = detail::every(k, 3);
    const Mask lazy = _mm512_cmpge_epi32_mask(index, _mm512_set1_epi32(32));
    columns[k]->v = _mm512_mask_permutexvar_ps(_mm512_permutex2var_ps(x, index, y), lazy, index, z);
  }
}
RINGLIGHT_INLINE void load_columns(const float* from, Vec& a, Vec& b, Vec& c, Vec& d) {
  const __m512 x = _mm512_loadu_ps(from), y = _mm512_loadu_ps(from + 16);
  const __m512 z = _mm512_loadu_ps(from + 32), w = _mm512_loadu_ps(from + 48);
  // Columns a and b side by side in one register, c and d in the other, first of rows 0-7, then of rows 8-15.
  const __m512i ab = _mm512_setr_epi32(0, 4, 8, 12, 16, 20, 24, 28, 1, 5, 9, 13, 17, 21, 25, 29);
  const __m512i cd = _mm512_add_epi32(ab, _mm512_set1_epi32(2));
  const __m512 ab_low = _mm512_permutex2var_ps(x, ab, y), ab_high = _mm512_permutex2var_ps(z, ab, w);
  const __m512 cd_low = _mm512_permutex2var_ps(x, cd, y), cd_high = _mm512_permutex2var_ps(z, cd, w);
  a = _mm512_shuffle_f32x4(ab_low, ab_high, 0x44);
  b = _mm512_shuffle_f32x4(ab_low, ab_high, 0xee);
  c = _mm512_shuffle_f32x4(cd_low, cd_high, 0x44);
  d = _mm512_shuffle_f32x4(cd_low, cd_high, 0xee);
}

// The way back: columns to rows of 2 (3, 4) floats.
RINGLIGHT_INLINE void store_columns(float* to, Vec a, Vec b) {
  const __m512i low = _mm512_setr_epi32(0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23);
  const __m512i high = _mm512_add_epi32(low, _mm512_set1_epi32(8));
  _mm512_storeu_ps(to, _mm512_permutex2var_ps(a.v, low, b.v));
  _mm512_storeu_ps(to + 16, _mm512_permutex2var_ps(a.v, high, b.v));
}
RINGLIGHT_INLINE void store_columns(float* to, Vec a, Vec b, Vec c) {
  // Element e of the rows is row e / 3 of column e % 3. First permute a and b in (16 + row picks b), then c.
  alignas(64) static const int row[3][16] = {{0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3, 4, 4, 4, 5},
                                             {5, 5, 6, 6, 6, 7, 7, 7, 8, 8, 8, 9, 9, 9, 10, 10},
                                             {10, 11, 11, 11, 12, 12, 12, 13, 13, 13, 14, 14, 14, 15, 15, 15}};
  static const Mask is_b[3] = {0x2492, 0x9249, 0x4924}, is_c[3] = {0x4924, 0x2492, 0x9249};
#pragma GCC unroll 3
  for (int k = 0; k < 3; k++) {
    const __m512i index = _mm512_load_si512(row[k]);
    __m512 rows = _mm512_permutexvar_ps(index, a.v);
    rows = _mm512_mask_permutexvar_ps(rows, is_b[k], index, b.v);
    rows = _mm512_mask_permutexvar_ps(rows, is_c[k], index, c.v);
    _mm512_storeu_ps(to + 16 * k, rows);
  }
}
RINGLIGHT_INLINE void store_columns(float* to, Vec a, Vec b, Vec c, Vec d) {
  const __m512d ab_low = _mm512_castps_pd(_mm512_unpacklo_ps(a.v, b.v));
  const __m512d ab_high = _mm512_castps_pd(_mm512_unpackhi_ps(a.v, b.v));
  const __m512d cd_low = _mm512_castps_pd(_mm512_unpacklo_ps(c.v, d.v));
  const __m512d cd_high = _mm512_castps_pd(_mm512_unpackhi_ps(c.v, d.v));
  // rows[j] holds rows j, 4 + j, 8 + j and 12 + j, one per quarter.
  Vec rows[4] = {
      _mm512_castpd_ps(_mm512_unpacklo_pd(ab_low, cd_low)), _mm512_castpd_ps(_mm512_unpackhi_pd(ab_low, cd_low)),
      _mm512_castpd_ps(_mm512_unpacklo_pd(ab_high, cd_high)), _mm512_castpd_ps(_mm512_unpackhi_pd(ab_high, cd_high))};
  transpose_quarters(rows);
#pragma GCC unroll 4
  for (int i = 0; i < 4; i++) store(to + 16 * i, rows[i]);
}
// Sixteen 64-bit words from their low and high halves.
RINGLIGHT_INLINE void store_words(std::uint64_t* to, IVec low, IVec high) {
  store_columns(reinterpret_cast<float*>(to), _mm512_castsi512_ps(low.v), _mm512_castsi512_ps(high.v));
}

// Bit j of words[i] becomes bit i of words[j].
RINGLIGHT_INLINE void transpose_bits(std::uint64_t words[64]) {
  // Byte r of every word, for the words 8 c .. 8 c + 7: a transpose of 8 x 8 bytes.
  alignas(64) static const std::uint8_t bytes[64] = {
      0, 8, 16, 24, 32, 40, 48, 56, 1, 9, 17, 25, 33, 41, 49, 57,
      2, 10, 18, 26, 34, 42, 50, 58, 3, 11, 19, 27, 35, 43, 51, 59,
      4, 12, 20, 28, 36, 44, 52, 60, 5, 13, 21, 29, 37, 45, 53, 61,
      6, 14, 22, 30, 38, 46, 54, 62, 7, 15, 23, 31, 39, 47, 55, 63};
  const __m512i byte_transpose = _mm512_load_si512(bytes);
  const __m512i reverse = _mm512_broadcast_i32x4(_mm_setr_epi8(7, 6, 5, 4, 3, 2, 1, 0, 15, 14, 13, 12, 11, 10, 9, 8));
  const __m512i identity = _mm512_set1_epi64(0x8040201008040201ull);
  __m512i part[8], pair[8];
  for (int i = 0; i < 8; i++) {
    const __m512i rows = _mm512_permutexvar_epi8(byte_transpose, _mm512_loadu_si512(words + 8 * i));
    // The affine product of the identity with a reversed matrix is the transposed 8 x 8 bits.
    part[i] = _mm512_gf2p8affine_epi64_epi8(identity, _mm512_shuffle_epi8(rows, reverse), 0);
  }
  for (int i = 0; i < 4; i++) {
    pair[2 * i] = _mm512_unpacklo_epi64(part[2 * i], part[2 * i + 1]);
    pair[2 * i + 1] = _mm512_unpackhi_epi64(part[2 * i], part[2 * i + 1]);
  }
  for (int b = 0; b < 2; b++) {
    const __m512i even_low = _mm512_shuffle_i64x2(pair[b], pair[2 + b], 0x88);
    const __m512i odd_low = _mm512_shuffle_i64x2(pair[b], pair[2 + b], 0xdd);
    const __m512i even_high = _mm512_shuffle_i64x2(pair[4 + b], pair[6 + b], 0x88);
    const __m512i odd_high = _mm512_shuffle_i64x2(pair[4 + b], pair[6 + b], 0xdd);
    part[b] = _mm512_shuffle_i64x2(even_low, even_high, 0x88);
    part[2 + b] = _mm512_shuffle_i64x2(odd_low, odd_high, 0x88);
    part[4 + b] = _mm512_shuffle_i64x2(even_low, even_high, 0xdd);
    part[6 + b] = _mm512_shuffle_i64x2(odd_low, odd_high, 0xdd);
  }
  for (int i = 0; i < 8; i++)
    _mm512_storeu_si512(words + 8 * i, _mm512_permutexvar_epi8(byte_transpose, part[i]));
}

// Writes first + (number of each set bit), ascending; returns how many. Up to 64 bytes from `to` may be overwritten.
RINGLIGHT_INLINE int list_set_bits(std::uint64_t word, int first, std::uint8_t* to) {
  alignas(64) static const std::uint8_t numbers[64] = {
      0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15,
      16, 17, 18, 19, 20, 21, 22, 23, 24, 25, 26, 27, 28, 29, 30, 31,
      32, 33, 34, 35, 36, 37, 38, 39, 40, 41, 42, 43, 44, 45, 46, 47,
      48, 49, 50, 51, 52, 53, 54, 55, 56, 57, 58, 59, 60, 61, 62, 63};
  const __m512i shifted = _mm512_add_epi8(_mm512_load_si512(numbers), _mm512_set1_epi8(static_cast<char>(first)));
  _mm512_storeu_si512(to, _mm512_maskz_compress_epi8(word, shifted));
  return __builtin_popcountll(word);
}

#ifdef __AVX512BF16__
// Sixteen lanes of two bfloat16 each (8 bits of mantissa): one multiply-add takes both, and adds them up in floats.
struct Bf16Pairs {
  __m512bh v;
  Bf16Pairs() = default;
  __attribute__((always_inline)) Bf16Pairs(Vec words) : v((__m512bh)words.v) {}
  __attribute__((always_inline)) explicit Bf16Pairs(float word) : v((__m512bh)_mm512_set1_ps(word)) {}
  __attribute__((always_inline)) Vec bits() const { return (__m512)v; }

  // Lane i holds first[i] and second[i].
  __attribute__((always_inline)) static Bf16Pairs of(Vec first, Vec second) {
    const __m512i order = _mm512_add_epi32(_mm512_set1_epi32(0x00100000), detail::every(0, 0x00010001));
    return Vec((__m512)_mm512_permutexvar_epi16(order, (__m512i)_mm512_cvtne2ps_pbh(second.v, first.v)));
  }
  // The same 32 numbers, neighbours in pairs: those of first, then those of second.
  __attribute__((always_inline)) static Bf16Pairs of_neighbours(Vec first, Vec second) {
    return Vec((__m512)_mm512_cvtne2ps_pbh(second.v, first.v));
  }
  // Lane K of each quarter of four lanes, in all lanes of that quarter.
  template <int K>
  __attribute__((always_inline)) Bf16Pairs lane_in_quarters() const {
    return Vec(_mm512_permute_ps(bits().v, K * 0x55));
  }
  // Quarter K in place of every quarter.
  template <int K>
  __attribute__((always_inline)) Bf16Pairs quarter() const {
    return Vec(_mm512_shuffle_f32x4(bits().v, bits().v, K * 0x55));
  }
  // Lane j of quarter i becomes lane i of quarter j.
  __attribute__((always_inline)) Bf16Pairs turned() const {
    const __m512i order = _mm512_setr_epi32(0, 4, 8, 12, 1, 5, 9, 13, 2, 6, 10, 14, 3, 7, 11, 15);
    return Vec(_mm512_permutexvar_ps(order, bits().v));
  }
  // Two 4 x 4 matrices, rows first: lane 2 m + k of quarter i holds elements (i, 2 k) and (i, 2 k + 1) of matrix m.
  __attribute__((always_inline)) static Bf16Pairs two_by_rows(Vec first, Vec second) {
    const __m512i order = _mm512_setr_epi64(0, 4, 1, 5, 2, 6, 3, 7);
    return Vec((__m512)_mm512_permutexvar_epi64(order, (__m512i)of_neighbours(first, second).bits().v));
  }
  // The same: lane j of quarter 2 m + k holds elements (2 k, j) and (2 k + 1, j) of matrix m.
  __attribute__((always_inline)) static Bf16Pairs two_by_columns(Vec first, Vec second) {
    const __m512i quarter = _mm512_setr_epi32(0x00040000, 0x00050001, 0x00060002, 0x00070003, 0x000c0008, 0x000d0009,
                                              0x000e000a, 0x000f000b, 0x00140010, 0x00150011, 0x00160012, 0x00170013,
                                              0x001c0018, 0x001d0019, 0x001e001a, 0x001f001b);
    return Vec((__m512)_mm512_permutexvar_epi16(quarter, (__m512i)of_neighbours(first, second).bits().v));
  }
  // Number i of both, side by side: for the first (Half 0) or the last (1) sixteen of the 32 numbers of each.
  template <int Half>
  __attribute__((always_inline)) static Bf16Pairs side_by_side(Bf16Pairs first, Bf16Pairs second) {
    const __m512i start = _mm512_set1_epi32(0x00200000 + 0x00100010 * Half);
    const __m512i order = _mm512_add_epi32(start, detail::every(0, 0x00010001));
    return Vec((__m512)_mm512_permutex2var_epi16((__m512i)first.v, order, (__m512i)second.v));
  }
  // Quarter i from and to `stride` floats after quarter i - 1.
  __attribute__((always_inline)) static Vec load_quarters(const float* from, int stride) {
    const __m512 two = _mm512_insertf32x4(_mm512_castps128_ps512(_mm_loadu_ps(from)), _mm_loadu_ps(from + stride), 1);
    const __m512 three = _mm512_insertf32x4(two, _mm_loadu_ps(from + 2 * stride), 2);
    return _mm512_insertf32x4(three, _mm_loadu_ps(from + 3 * stride), 3);
  }
  __attribute__((always_inline)) static void store_quarters(float* to, int stride, Vec a) {
    _mm_storeu_ps(to, _mm512_castps512_ps128(a.v));
    _mm_storeu_ps(to + stride, _mm512_extractf32x4_ps(a.v, 1));
    _mm_storeu_ps(to + 2 * stride, _mm512_extractf32x4_ps(a.v, 2));
    _mm_storeu_ps(to + 3 * stride, _mm512_extractf32x4_ps(a.v, 3));
  }
  // One lane: the bits of both as a float, to be copied only.
  static float one(float first, float second) {
    return _mm512_cvtss_f32(of(Vec(first), Vec(second)).bits().v);
  }
};
RINGLIGHT_INLINE void store(float* to, Bf16Pairs a) { store(to, a.bits()); }
// a b + c, both products of a lane.
RINGLIGHT_INLINE Vec fma(Bf16Pairs a, Bf16Pairs b, Vec c) { return _mm512_dpbf16_ps(c.v, a.v, b.v); }
#endif

}  // namespace ringlight::RINGLIGHT_ISA
