#include "dispatch.hpp"

#ifdef __x86_64__
#include <cpuid.h>
#endif

#include <cstdlib>
#include <stdexcept>
#include <string>

namespace ringlight {
namespace {

#ifdef __x86_64__
// The part of x86-64-v3 for which not every compiler's __builtin_cpu_supports has a name.
bool has_lesser_v3() {
  constexpr unsigned MOVBE = 1u << 22, F16C = 1u << 29, LZCNT = 1u << 5;
  unsigned eax, ebx, basic, extended, edx;
  return __get_cpuid(1, &eax, &ebx, &basic, &edx) && (basic & MOVBE) && (basic & F16C) &&
         __get_cpuid(0x80000001, &eax, &ebx, &extended, &edx) && (extended & LZCNT);
}

// Everything that the compiler may use by CMakeLists.txt is asked for: virtual machines mask features one by one, and
// a processor may have AVX-512 without VBMI2.
bool has_v3() {
  __builtin_cpu_init();
  return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi") &&
         __builtin_cpu_supports("bmi2") && has_lesser_v3();
}

bool has_v4() {
  return has_v3() && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
         __builtin_cpu_supports("avx512cd") && __builtin_cpu_supports("avx512dq") &&
         __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512vbmi") &&
         __builtin_cpu_supports("avx512vbmi2") && __builtin_cpu_supports("avx512bitalg") &&
         __builtin_cpu_supports("avx512vpopcntdq") && __builtin_cpu_supports("avx512vnni") &&
         __builtin_cpu_supports("gfni");
}
// Not every compiler's __builtin_cpu_supports has a name for it.
bool has_v4_bf16() {
  constexpr unsigned AVX512_BF16 = 1u << 5;
  unsigned eax, ebx, ecx, edx;
  return has_v4() && __get_cpuid_count(7, 1, &eax, &ebx, &ecx, &edx) && (eax & AVX512_BF16);
}
#else
bool has_v3() { return false; }
bool has_v4() { return false; }
bool has_v4_bf16() { return false; }
#endif

Isa choose() {
  const char* forced = std::getenv("RINGLIGHT_ISA");
  const std::string wish = forced ? forced : "";
  if (wish.empty()) return has_v4_bf16() ? Isa::v4_bf16 : has_v4() ? Isa::v4 : has_v3() ? Isa::v3 : Isa::generic;
  if (wish == "generic") return Isa::generic;
  if (wish != "avx2" && wish != "avx512" && wish != "avx512_bf16")
    throw std::runtime_error("RINGLIGHT_ISA=" + wish +
                             " is unknown; use generic, avx2, avx512 or avx512_bf16, or unset it");
  if (wish == "avx2" && !has_v3())
    throw std::runtime_error("RINGLIGHT_ISA=avx2, but this processor lacks AVX2 (x86-64-v3); unset it");
  if (wish == "avx512" && !has_v4())
    throw std::runtime_error("RINGLIGHT_ISA=avx512, but this processor lacks AVX-512 with VBMI2; unset it");
  if (wish == "avx512_bf16" && !has_v4_bf16())
    throw std::runtime_error("RINGLIGHT_ISA=avx512_bf16, but this processor lacks AVX-512 BF16; unset it");
  return wish == "avx2" ? Isa::v3 : wish == "avx512" ? Isa::v4 : Isa::v4_bf16;
}

}  // namespace

Isa current_isa() {
  static const Isa isa = choose();
  return isa;
}

const char* isa_name(Isa isa) {
  return isa == Isa::v4_bf16 ? "avx512_bf16" : isa == Isa::v4 ? "avx512" : isa == Isa::v3 ? "avx2" : "generic";
}

}  // namespace ringlight
