#include "simd/dispatch.hpp"

#ifdef __x86_64__
#include <cpuid.h>
#endif
#ifdef __linux__
#include <sys/syscall.h>
#include <unistd.h>
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

// Not every compiler's __builtin_cpu_supports has a name for these.
bool has_v4_bf16() {
  constexpr unsigned AVX512_BF16 = 1u << 5;
  unsigned eax, ebx, ecx, edx;
  return has_v4() && __get_cpuid_count(7, 1, &eax, &ebx, &ecx, &edx) && (eax & AVX512_BF16);
}

// Tiles are 8 KB more for the system to keep of each thread, so that Linux wants to be asked for them once a process.
bool may_use_tiles() {
#ifdef __linux__
  constexpr long REQUEST_PERMISSION = 0x1023, TILES = 18;  // ARCH_REQ_XCOMP_PERM, XFEATURE_XTILEDATA
  return syscall(SYS_arch_prctl, REQUEST_PERMISSION, TILES) == 0;
#else
  return false;
#endif
}

bool has_v4_amx() {
  constexpr unsigned AMX_BF16 = 1u << 22, AMX_TILE = 1u << 24;
  unsigned eax, ebx, ecx, edx;
  return has_v4_bf16() && __get_cpuid_count(7, 0, &eax, &ebx, &ecx, &edx) && (edx & AMX_BF16) && (edx & AMX_TILE) &&
         may_use_tiles();
}

// Intel's take twice as long for a multiply-add of pairs of bfloat16 as for one of floats.
bool has_fast_v4_bf16() { return has_v4_bf16() && !__builtin_cpu_is("intel"); }
#else
bool has_v3() { return false; }
bool has_v4() { return false; }
bool has_v4_bf16() { return false; }
bool has_fast_v4_bf16() { return false; }
bool has_v4_amx() { return false; }
#endif

bool has_generic() { return true; }

struct Set {
  Isa isa;
  const char *name, *parts;
  bool (*is_there)(), (*is_best)();  // is_best: if those before it are not there
};
constexpr Set SETS[] = {
    {Isa::v4_amx, "avx512_amx", "AMX with BF16, or the system keeps it back", has_v4_amx, has_v4_amx},
    {Isa::v4_bf16, "avx512_bf16", "AVX-512 BF16", has_v4_bf16, has_fast_v4_bf16},
    {Isa::v4, "avx512", "AVX-512 with VBMI2", has_v4, has_v4},
    {Isa::v3, "avx2", "AVX2 (x86-64-v3)", has_v3, has_v3},
    {Isa::generic, "generic", "", has_generic, has_generic},
};

Isa choose() {
  const char* forced = std::getenv("RINGLIGHT_ISA");
  const std::string wish = forced ? forced : "";
  for (const Set& set : SETS) {
    if (wish.empty() && set.is_best()) return set.isa;
    if (wish != set.name) continue;
    if (set.is_there()) return set.isa;
    throw std::runtime_error("RINGLIGHT_ISA=" + wish + ", but this processor lacks " + set.parts + "; unset it");
  }
  throw std::runtime_error("RINGLIGHT_ISA=" + wish +
                           " is unknown; use generic, avx2, avx512, avx512_bf16 or avx512_amx, or unset it");
}

}  // namespace

Isa current_isa() {
  static const Isa isa = choose();
  return isa;
}

const char* isa_name(Isa isa) {
  for (const Set& set : SETS)
    if (set.isa == isa) return set.name;
  return "";
}

}  // namespace ringlight
