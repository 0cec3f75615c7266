// Sixteen float lanes as one value, whatever the processor: one AVX-512 register, two AVX2 registers, or four of four
// floats. One pixel block of 4 x 4, or sixteen Gaussians, fill one Vec.
//
// The only place of the kernels that asks for the instruction set. Here and in every other x.isa.hpp the types live in
// the namespace of the instruction set and the functions have internal linkage, so that the linker cannot merge the
// AVX-512 copy of a function with another copy (cmake/check_isa_symbols.py looks after that).
//
// Types:  Vec (16 floats), Mask (16 lanes on or off), IVec (16 signed 32-bit integers).
// Naming: load/store take any alignment; ge, gt, lt compare to a Mask; keep(mask, x) is x where on and 0 elsewhere.
#pragma once
#ifndef RINGLIGHT_ISA
#error "x.isa.hpp is for x.isa.cpp alone, which is compiled once for every instruction set"
#endif

#include <cstddef>
#include <cstdint>

#ifdef __AVX2__
// GCC 12 calls its own _mm512_undefined_ps() an uninitialised variable (GCC bug 105593).
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wuninitialized"
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#include <immintrin.h>
#pragma GCC diagnostic pop
#endif

#define RINGLIGHT_INLINE static inline __attribute__((always_inline))

namespace ringlight::RINGLIGHT_ISA {
constexpr int LANES = 16;  // floats in a Vec
}

#ifdef __AVX512F__
#include "simd/avx512.isa.hpp"
#include "simd/bytes.isa.hpp"
#elif defined __AVX2__
#include "simd/avx2.isa.hpp"
#include "simd/columns.isa.hpp"
#else
#include "simd/generic.isa.hpp"
#include "simd/columns.isa.hpp"
#endif

#include "simd/matrix_unit.isa.hpp"
#include "simd/math.isa.hpp"
