// Which instruction sets have a copy of a kernel, and which of them runs: that is decided once per process.
#pragma once
namespace ringlight {

// x86-64-v3: AVX2 and FMA; v4: AVX-512 with VBMI2, BITALG, VPOPCNTDQ, VNNI, GFNI; v4_bf16: and BF16; v4_amx: and
// AMX, a matrix unit; generic: what every processor of this kind has, several times slower.
enum class Isa { generic, v3, v4, v4_bf16, v4_amx };

// The best set that this processor has; the environment variable RINGLIGHT_ISA=generic, avx2, avx512, avx512_bf16 or
// avx512_amx forces one.
// Throws std::runtime_error with a sentence for the user if the value is unknown or the processor lacks it.
Isa current_isa();

const char* isa_name(Isa isa);

}  // namespace ringlight

// declare(namespace) for each instruction set that has a copy of a kernel.
#define RINGLIGHT_EVERY_ISA(declare) declare(generic) declare(v3) declare(v4)
// The same for kernels that gain by bfloat16 products, which have two copies more.
#define RINGLIGHT_EVERY_ISA_AND_BF16(declare) RINGLIGHT_EVERY_ISA(declare) declare(v4_bf16) declare(v4_amx)

// The copy of a kernel that this process runs: RINGLIGHT_CHOSEN(adam)(value, ...).
#ifdef __x86_64__
#define RINGLIGHT_CHOSEN(kernel)                           \
  (::ringlight::current_isa() >= ::ringlight::Isa::v4   ? ::ringlight::v4::kernel \
   : ::ringlight::current_isa() == ::ringlight::Isa::v3 ? ::ringlight::v3::kernel \
                                                        : ::ringlight::generic::kernel)
// The same for a kernel that has copies with bfloat16 products.
#define RINGLIGHT_CHOSEN_WITH_BF16(kernel)                 \
  (::ringlight::current_isa() == ::ringlight::Isa::v4_amx    ? ::ringlight::v4_amx::kernel \
   : ::ringlight::current_isa() == ::ringlight::Isa::v4_bf16 ? ::ringlight::v4_bf16::kernel \
                                                             : RINGLIGHT_CHOSEN(kernel))
#else
#define RINGLIGHT_CHOSEN(kernel) (::ringlight::generic::kernel)
#define RINGLIGHT_CHOSEN_WITH_BF16(kernel) RINGLIGHT_CHOSEN(kernel)
#endif
