// Functions of a Vec that are written once for every instruction set. Included by simd.isa.hpp only.
#pragma once

namespace ringlight::RINGLIGHT_ISA {

// What the fastest multiply-add of this instruction set takes, in dense layers and in products of the ring's matrices,
// and how many numbers a lane of it holds. Processors with a matrix unit take twice as long for a multiply-add of pairs
// outside of it as for one of floats.
template <class Terms>
constexpr int numbers_of = 1;
#ifdef __AVX512BF16__
using LayerTerms = Bf16Pairs;
template <>
constexpr int numbers_of<Bf16Pairs> = 2;
#else
using LayerTerms = Vec;
#endif
#if defined __AVX512BF16__ && !defined __AMX_BF16__
using MatrixTerms = Bf16Pairs;
#else
using MatrixTerms = Vec;
#endif

// The same where numbers are bytes; an instruction set without such multiply-adds, or with a matrix unit, has none to
// offer.
#if defined __AVX512VNNI__ && !defined __AMX_BF16__
using FastBytes = ByteQuads;
template <>
constexpr int numbers_of<ByteQuads> = 4;
#else
using FastBytes = LayerTerms;
#endif
template <class Terms>
constexpr bool are_bytes = numbers_of<Terms> == 4;

RINGLIGHT_INLINE Vec operator-(Vec a) { return Vec(0.f) - a; }
RINGLIGHT_INLINE Vec& operator+=(Vec& a, Vec b) { return a = a + b; }

// On where a is neither infinite nor NaN: 0 a is then 0, and NaN otherwise.
RINGLIGHT_INLINE Mask is_finite(Vec a) { return ge(a * Vec(0.f), Vec(0.f)); }

// Value of a polynomial, coefficients from the constant upwards (Horner).
template <int Count>
RINGLIGHT_INLINE Vec polynomial(Vec x, const float (&coefficients)[Count]) {
  Vec value(coefficients[Count - 1]);
#pragma GCC unroll 16
  for (int i = Count - 2; i >= 0; i--) value = fma(value, x, Vec(coefficients[i]));
  return value;
}

// 2^x with relative error below 3e-7: minimax polynomial of degree 5 for the fraction. For inner loops.
// The caller keeps x in [-126, 127] or ignores the lanes that are not.
RINGLIGHT_INLINE Vec exp2_fast(Vec x) {
  constexpr float C0 = 0.9999999403953552f, C1 = 0.6931530833244324f, C2 = 0.24015361070632935f;
  constexpr float C3 = 0.05582631751894951f, C4 = 0.008989340625703335f, C5 = 0.0018775764819619f;
  const Vec f = fraction(x), square = f * f;
  // Estrin's order: three steps deep where Horner's is five, and the depth is what the inner loops wait for.
  const Vec low = fma(Vec(C1), f, Vec(C0)), middle = fma(Vec(C3), f, Vec(C2)), high = fma(Vec(C5), f, Vec(C4));
  return scale_by_floor(fma(fma(high, square, middle), square, low), x);
}

// e^x to about 2 ulp. x is clamped to +-87, where the result is still a normal number; NaN stays NaN.
RINGLIGHT_INLINE Vec exp(Vec x) {
  // Taylor series up to x^7 / 7!: |remainder| < 6e-9 for |x| <= ln(2) / 2.
  static const float coefficients[] = {1.f, 1.f, 1.f / 2, 1.f / 6, 1.f / 24, 1.f / 120, 1.f / 720, 1.f / 5040};
  const Vec clamped = max(Vec(-87.f), min(Vec(87.f), x));  // in this order min and max hand a NaN on
  const Vec whole = round(clamped * Vec(1.44269504f));
  // ln 2 in two parts, so that the product with `whole` is exact in the first (Cody & Waite).
  const Vec fraction = fnma(whole, Vec(-2.12194440e-4f), fnma(whole, Vec(0.693359375f), clamped));
  return scale_by_power(polynomial(fraction, coefficients), whole);
}

// 1 / (1 + e^-x) to about 2 ulp.
RINGLIGHT_INLINE Vec sigmoid(Vec x) { return Vec(1.f) / (Vec(1.f) + exp(-x)); }

// tanh(x) to about 2 ulp: odd polynomial (Chebyshev fit, relative error 1e-7) near zero, exponential beyond.
RINGLIGHT_INLINE Vec tanh(Vec x) {
  static const float coefficients[] = {-0.3333333f, 0.13332783f, -0.0538525f, 0.021003641f, -0.006104948f};
  const Vec square = x * x;
  const Vec near = fma(x * square, polynomial(square, coefficients), x);
  const Vec far = Vec(1.f) - Vec(2.f) / (exp(x + x) + Vec(1.f));
  return select(lt(square, Vec(0.390625f)), near, far);  // |x| < 0.625
}

// tanh(x) with an absolute error below 3e-7, in less than half the time: no relative accuracy near zero. NaN stays NaN.
RINGLIGHT_INLINE Vec tanh_fast(Vec x) {
  // e^2x within what a float holds; beyond, the result is 1 to the last bit.
  const Vec power = exp2_fast(max(Vec(-30.f), min(Vec(30.f), x * Vec(2.88539008f))));
  return fnma(Vec(2.f), reciprocal(power + Vec(1.f)), Vec(1.f));
}

// log2(x) to about 2 ulp (absolute error below 2e-7 near 1), for positive normal x.
RINGLIGHT_INLINE Vec log2(Vec x) {
  const Vec raw = mantissa(x);
  const Mask upper = gt(raw, Vec(1.41421356f));  // centre the mantissa on 1: [0.707, 1.414]
  const Vec centred = select(upper, raw * Vec(0.5f), raw);
  const Vec whole = exponent(x) + keep(upper, Vec(1.f));
  // log2(m) = 2 / ln(2) atanh(s), s = (m - 1) / (m + 1), |s| < 0.172: terms up to s^9.
  static const float coefficients[] = {2.885390082f, 0.961796694f, 0.577078016f, 0.412198583f, 0.320598898f};
  const Vec s = (centred - Vec(1.f)) / (centred + Vec(1.f));
  return fma(s, polynomial(s * s, coefficients), whole);
}

}  // namespace ringlight::RINGLIGHT_ISA
