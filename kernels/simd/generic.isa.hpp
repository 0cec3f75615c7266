// Vec over the vectors of four that GCC and clang know on every processor (SSE2, NEON, ...). Included by simd.isa.hpp
// only, which says what the functions mean. For machines without AVX2, and to be tested on those that have it.
#pragma once

namespace ringlight::RINGLIGHT_ISA {

// How many Vecs the register file holds: 16 or 32 registers of four floats.
constexpr int VEC_REGISTERS = 4;

namespace detail {
constexpr int PARTS = 4;
using Floats = float __attribute__((vector_size(16)));
using Ints = int __attribute__((vector_size(16)));
using Words = unsigned __attribute__((vector_size(16)));
using FloatsInMemory = float __attribute__((vector_size(16), aligned(4), may_alias));
using IntsInMemory = int __attribute__((vector_size(16), aligned(4), may_alias));

// Minus a zero, which changes no number: plus would turn -0 into 0.
RINGLIGHT_INLINE Floats broadcast(float value) { return value - Floats{}; }
}  // namespace detail

struct Vec {
  detail::Floats part[detail::PARTS];
  Vec() = default;
  __attribute__((always_inline)) Vec(float value)
      : part{detail::broadcast(value), detail::broadcast(value), detail::broadcast(value), detail::broadcast(value)} {}
};
struct IVec {
  detail::Ints part[detail::PARTS];
};
struct Mask {
  detail::Ints part[detail::PARTS];  // all bits of a lane are set where it is on
};

// Result name(...) { part by part: expression of the parts a, b, c }
#define RINGLIGHT_PARTS1(Result, Operand, name, expression)             \
  RINGLIGHT_INLINE Result name(Operand x) {                             \
    Result result;                                                      \
    _Pragma("GCC unroll 4") for (int i = 0; i < detail::PARTS; i++) {   \
      const auto a = x.part[i];                                         \
      result.part[i] = expression;                                      \
    }                                                                   \
    return result;                                                      \
  }
#define RINGLIGHT_PARTS2(Result, Operand, name, expression)             \
  RINGLIGHT_INLINE Result name(Operand x, Operand y) {                  \
    Result result;                                                      \
    _Pragma("GCC unroll 4") for (int i = 0; i < detail::PARTS; i++) {   \
      const auto a = x.part[i], b = y.part[i];                          \
      result.part[i] = expression;                                      \
    }                                                                   \
    return result;                                                      \
  }
#define RINGLIGHT_PARTS3(Result, Operand, name, expression)             \
  RINGLIGHT_INLINE Result name(Operand x, Operand y, Operand z) {       \
    Result result;                                                      \
    _Pragma("GCC unroll 4") for (int i = 0; i < detail::PARTS; i++) {   \
      const auto a = x.part[i], b = y.part[i], c = z.part[i];           \
      result.part[i] = expression;                                      \
    }                                                                   \
    return result;                                                      \
  }
#define RINGLIGHT_SELECT(Value, Parts)                                                                  \
  RINGLIGHT_INLINE Value select(Mask on, Value x, Value y) {                                            \
    Value result;                                                                                       \
    _Pragma("GCC unroll 4") for (int i = 0; i < detail::PARTS; i++)                                     \
        result.part[i] = (Parts)((on.part[i] & (detail::Ints)x.part[i]) |                               \
                                 (~on.part[i] & (detail::Ints)y.part[i]));                              \
    return result;                                                                                      \
  }                                                                                                     \
  RINGLIGHT_INLINE Value keep(Mask on, Value x) {                                                       \
    Value result;                                                                                       \
    _Pragma("GCC unroll 4") for (int i = 0; i < detail::PARTS; i++)                                     \
        result.part[i] = (Parts)(on.part[i] & (detail::Ints)x.part[i]);                                 \
    return result;                                                                                      \
  }

RINGLIGHT_INLINE Vec load(const float* from) {
  Vec result;
#pragma GCC unroll 4
  for (int i = 0; i < detail::PARTS; i++)
    result.part[i] = *reinterpret_cast<const detail::FloatsInMemory*>(from + 4 * i);
  return result;
}
RINGLIGHT_INLINE void store(float* to, Vec a) {
#pragma GCC unroll 4
  for (int i = 0; i < detail::PARTS; i++) *reinterpret_cast<detail::FloatsInMemory*>(to + 4 * i) = a.part[i];
}
// from[K .. K + 15]; the Vecs around it would take more to put together than a load.
template <int K>
RINGLIGHT_INLINE Vec load_shifted(const float* from, Vec, Vec, Vec) {
  return load(from + K);
}
// The first `count` floats (0..16); the remaining lanes are 0 and their memory is not touched.
RINGLIGHT_INLINE Vec load_first(const float* from, int count) {
  float lanes[LANES] = {};
  for (int i = 0; i < count; i++) lanes[i] = from[i];
  return load(lanes);
}
RINGLIGHT_INLINE void store_first(float* to, Vec a, int count) {
  float lanes[LANES];
  store(lanes, a);
  for (int i = 0; i < count; i++) to[i] = lanes[i];
}

RINGLIGHT_PARTS2(Vec, Vec, operator+, a + b)
RINGLIGHT_PARTS2(Vec, Vec, operator-, a - b)
RINGLIGHT_PARTS2(Vec, Vec, operator*, a * b)
RINGLIGHT_PARTS2(Vec, Vec, operator/, a / b)
namespace detail {
// a b + c, rounded once where the processor can. Lane by lane, for the compiler may not fuse a product that it sees.
RINGLIGHT_INLINE Floats fma_part(Floats a, Floats b, Floats c) {
#ifdef __FP_FAST_FMAF
  return Floats{__builtin_fmaf(a[0], b[0], c[0]), __builtin_fmaf(a[1], b[1], c[1]),
                __builtin_fmaf(a[2], b[2], c[2]), __builtin_fmaf(a[3], b[3], c[3])};
#else
  return a * b + c;
#endif
}
RINGLIGHT_INLINE Floats sqrt_part(Floats a) {
  return Floats{__builtin_sqrtf(a[0]), __builtin_sqrtf(a[1]), __builtin_sqrtf(a[2]), __builtin_sqrtf(a[3])};
}
RINGLIGHT_INLINE Floats abs_part(Floats a) { return (Floats)((Ints)a & 0x7fffffff); }
RINGLIGHT_INLINE Floats pick(Ints on, Floats a, Floats b) { return (Floats)((on & (Ints)a) | (~on & (Ints)b)); }
// From here on every float is whole, and conversions to integers and back could overflow.
constexpr float WHOLE = 1 << 23;
RINGLIGHT_INLINE Floats whole_part(Floats a) {  // towards zero; NaN stays
  return pick(abs_part(a) < WHOLE, __builtin_convertvector(__builtin_convertvector(a, Ints), Floats), a);
}
RINGLIGHT_INLINE Floats floor_part(Floats a) {
  const Floats whole = whole_part(a);
  return whole - (Floats)((whole > a) & (Ints)broadcast(1.f));
}
RINGLIGHT_INLINE Floats ceil_part(Floats a) {
  const Floats whole = whole_part(a);
  return whole + (Floats)((whole < a) & (Ints)broadcast(1.f));
}
// To the nearest, halves to the even one: adding 1.5 2^23 pushes the fraction out.
RINGLIGHT_INLINE Floats round_part(Floats a) {
  return pick(abs_part(a) < 0.5f * WHOLE, (a + 1.5f * WHOLE) - 1.5f * WHOLE, a);
}
}  // namespace detail
RINGLIGHT_PARTS3(Vec, Vec, fma, detail::fma_part(a, b, c))    // a b + c
RINGLIGHT_PARTS3(Vec, Vec, fnma, detail::fma_part(-a, b, c))  // c - a b
RINGLIGHT_PARTS2(Vec, Vec, min, detail::pick(a < b, a, b))    // b where either is NaN
RINGLIGHT_PARTS2(Vec, Vec, max, detail::pick(a > b, a, b))    // b where either is NaN
RINGLIGHT_PARTS1(Vec, Vec, sqrt, detail::sqrt_part(a))
RINGLIGHT_PARTS1(Vec, Vec, floor, detail::floor_part(a))
RINGLIGHT_PARTS1(Vec, Vec, ceil, detail::ceil_part(a))
RINGLIGHT_PARTS1(Vec, Vec, round, detail::round_part(a))
RINGLIGHT_PARTS1(Vec, Vec, abs, detail::abs_part(a))
RINGLIGHT_PARTS1(Vec, Vec, reciprocal, 1.f / a)

RINGLIGHT_PARTS2(Mask, Vec, ge, a >= b)
RINGLIGHT_PARTS2(Mask, Vec, gt, a > b)
RINGLIGHT_PARTS2(Mask, Vec, lt, a < b)
RINGLIGHT_PARTS2(Mask, Mask, both, a & b)
namespace detail {
constexpr Ints LANE_BITS[PARTS] = {{1, 2, 4, 8}, {16, 32, 64, 128}, {256, 512, 1024, 2048}, {4096, 8192, 16384, 32768}};
}
RINGLIGHT_INLINE bool any(Mask a) {
  const detail::Ints all = (a.part[0] | a.part[1]) | (a.part[2] | a.part[3]);
  return (all[0] | all[1] | all[2] | all[3]) != 0;
}
RINGLIGHT_INLINE unsigned bits(Mask a) {  // lane i is bit i
  detail::Ints all = {};
#pragma GCC unroll 4
  for (int i = 0; i < detail::PARTS; i++) all |= a.part[i] & detail::LANE_BITS[i];
  return static_cast<unsigned>(all[0] | all[1] | all[2] | all[3]);
}
RINGLIGHT_INLINE Mask mask_from_bits(unsigned a) {
  Mask result;
#pragma GCC unroll 4
  for (int i = 0; i < detail::PARTS; i++)
    result.part[i] = (static_cast<int>(a) & detail::LANE_BITS[i]) == detail::LANE_BITS[i];
  return result;
}
RINGLIGHT_SELECT(Vec, detail::Floats)
RINGLIGHT_SELECT(IVec, detail::Ints)

RINGLIGHT_INLINE IVec ivec(int value) {
  const detail::Ints part = value - detail::Ints{};
  return {{part, part, part, part}};
}
RINGLIGHT_PARTS1(IVec, Vec, truncate, __builtin_convertvector(a, detail::Ints))  // towards zero
RINGLIGHT_PARTS1(Vec, IVec, as_floats, (detail::Floats)a)
RINGLIGHT_PARTS1(Vec, IVec, to_float, __builtin_convertvector(a, detail::Floats))
RINGLIGHT_PARTS2(IVec, IVec, operator+, (detail::Ints)((detail::Words)a + (detail::Words)b))
RINGLIGHT_PARTS2(IVec, IVec, operator-, (detail::Ints)((detail::Words)a - (detail::Words)b))
RINGLIGHT_PARTS2(IVec, IVec, operator&, a & b)
RINGLIGHT_PARTS2(IVec, IVec, operator|, a | b)
RINGLIGHT_PARTS2(IVec, IVec, shift_left, (detail::Ints)((detail::Words)a << (detail::Words)b))
RINGLIGHT_PARTS2(IVec, IVec, shift_right, (detail::Ints)((detail::Words)a >> (detail::Words)b))
template <int By>
RINGLIGHT_PARTS1(IVec, IVec, shift_left, (detail::Ints)((detail::Words)a << By))
template <int By>
RINGLIGHT_PARTS1(IVec, IVec, shift_right, (detail::Ints)((detail::Words)a >> By))
RINGLIGHT_INLINE void store(void* to, IVec a) {
#pragma GCC unroll 4
  for (int i = 0; i < detail::PARTS; i++) static_cast<detail::IntsInMemory*>(to)[i] = a.part[i];
}
RINGLIGHT_INLINE IVec load_ints(const void* from) {
  IVec result;
#pragma GCC unroll 4
  for (int i = 0; i < detail::PARTS; i++) result.part[i] = static_cast<const detail::IntsInMemory*>(from)[i];
  return result;
}

// a 2^n for whole n, and the other way: a = mantissa 2^exponent with mantissa in [1, 2), for positive normal a.
// Here n is not checked: the result must be a normal number too.
namespace detail {
RINGLIGHT_INLINE Floats scale_part(Floats a, Floats n) {
  return (Floats)((Words)a + ((Words)__builtin_convertvector(n, Ints) << 23));
}
RINGLIGHT_INLINE Floats exponent_part(Floats a) {
  return __builtin_convertvector((Ints)((Words)a >> 23) - 127, Floats);
}
}  // namespace detail
RINGLIGHT_PARTS2(Vec, Vec, scale_by_power, detail::scale_part(a, b))
// x - floor(x), and a 2^floor(x).
RINGLIGHT_INLINE Vec fraction(Vec x) { return x - floor(x); }
RINGLIGHT_INLINE Vec scale_by_floor(Vec a, Vec x) { return scale_by_power(a, floor(x)); }
RINGLIGHT_PARTS1(Vec, Vec, exponent, detail::exponent_part(a))
RINGLIGHT_PARTS1(Vec, Vec, mantissa, (detail::Floats)(((detail::Ints)a & 0x007fffff) | 0x3f800000))

// Quarter j (four lanes) of rows[i] becomes quarter i of rows[j].
RINGLIGHT_INLINE void transpose_quarters(Vec rows[4]) {
  const Vec from[4] = {rows[0], rows[1], rows[2], rows[3]};
#pragma GCC unroll 4
  for (int i = 0; i < 4; i++)
#pragma GCC unroll 4
    for (int j = 0; j < 4; j++) rows[j].part[i] = from[i].part[j];
}

// rows[i] lane j becomes rows[j] lane i.
RINGLIGHT_INLINE void transpose(Vec rows[16]) {
  float from[16][16], to[16][16];
  for (int i = 0; i < 16; i++) store(from[i], rows[i]);
  for (int i = 0; i < 16; i++)
    for (int j = 0; j < 16; j++) to[i][j] = from[j][i];
  for (int i = 0; i < 16; i++) rows[i] = load(to[i]);
}

// No way of its own with sixteen rows of eight floats.
RINGLIGHT_INLINE bool load_eights(const float*, Vec*) { return false; }
RINGLIGHT_INLINE bool store_eights(float*, const Vec*) { return false; }

RINGLIGHT_INLINE float sum(Vec a) {
  const detail::Floats four = (a.part[0] + a.part[2]) + (a.part[1] + a.part[3]);
  return (four[0] + four[2]) + (four[1] + four[3]);
}
// Lane i holds the sum of the lanes of terms[i]; lanes from Count on are 0. Count <= 16.
template <int Count>
RINGLIGHT_INLINE Vec lane_sums(const Vec* terms) {
  float sums[LANES] = {};
  for (int i = 0; i < Count; i++) sums[i] = sum(terms[i]);
  return load(sums);
}

// Sixteen 64-bit words from their low and high halves.
RINGLIGHT_INLINE void store_words(std::uint64_t* to, IVec low, IVec high) {
  std::uint32_t lows[LANES], highs[LANES];
  store(lows, low);
  store(highs, high);
  for (int i = 0; i < LANES; i++) to[i] = std::uint64_t{highs[i]} << 32 | lows[i];
}

#undef RINGLIGHT_PARTS1
#undef RINGLIGHT_PARTS2
#undef RINGLIGHT_PARTS3
#undef RINGLIGHT_SELECT

}  // namespace ringlight::RINGLIGHT_ISA
