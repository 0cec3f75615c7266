// Multiply-adds of bytes, AVX-512's VNNI. Included by simd.isa.hpp only.
#pragma once

namespace ringlight::RINGLIGHT_ISA {

// Sixteen sums of products of bytes. Of the type that GCC's multiply-add has: with others it moves every sum to the
// stack.
struct ByteSums {
  __v16si v;
  __attribute__((always_inline)) static ByteSums zero() { return {(__v16si)_mm512_setzero_si512()}; }
};
// Four numbers in a lane: as the first factor of a multiply-add 0 to 255, as the second -128 to 127.
struct ByteQuads {
  using Sums = ByteSums;
  __m512i v;
  ByteQuads() = default;
  __attribute__((always_inline)) ByteQuads(IVec words) : v(words.v) {}

  // Lane i holds a[i] to d[i], rounded. They must lie between 0 and 255.
  __attribute__((always_inline)) static ByteQuads of(Vec a, Vec b, Vec c, Vec d) {
    const Vec ones(8388608.f);  // 2^23: added to it, a number's last bit counts ones, and its last byte is the number
    const __m512i order = _mm512_add_epi32(_mm512_set1_epi32(0x40004000), detail::every(0, 0x04040404));
    const auto bits = [=](Vec x) __attribute__((always_inline)) { return _mm512_castps_si512((x + ones).v); };
    const __m512i ab = _mm512_permutex2var_epi8(bits(a), order, bits(b));
    const __m512i cd = _mm512_permutex2var_epi8(bits(c), order, bits(d));
    return IVec{_mm512_mask_blend_epi16(0xaaaaaaaa, ab, cd)};
  }
};
RINGLIGHT_INLINE void store(void* to, ByteQuads a) { _mm512_storeu_si512(to, a.v); }
// a b + c, the four products of a lane.
RINGLIGHT_INLINE ByteSums fma(ByteQuads a, ByteQuads b, ByteSums c) {
  return {(__v16si)_mm512_dpbusd_epi32((__m512i)c.v, a.v, b.v)};
}
RINGLIGHT_INLINE Vec to_float(ByteSums a) { return _mm512_cvtepi32_ps((__m512i)a.v); }

}  // namespace ringlight::RINGLIGHT_ISA
