// Which instruction set the kernels run on, decided once per process.
#pragma once
namespace ringlight {

enum class Isa { v3, v4 };  // x86-64-v3: AVX2 and FMA; v4: AVX-512 with VBMI2, BITALG, VPOPCNTDQ, GFNI

// The best set that this processor has; the environment variable RINGLIGHT_ISA=avx2 forces v3.
// Throws std::runtime_error with a sentence for the user if the processor lacks AVX2 or the value is unknown.
Isa current_isa();

const char* isa_name(Isa isa);

}  // namespace ringlight
