// The namespaces that hold a copy of every kernel, one per instruction set (dispatch.hpp says which one runs).
#pragma once

// declare(namespace) for each of them.
#define RINGLIGHT_EVERY_ISA(declare) declare(generic) declare(v3) declare(v4)
// The same for kernels that gain by bfloat16 products, which have two copies more.
#define RINGLIGHT_EVERY_ISA_AND_BF16(declare) RINGLIGHT_EVERY_ISA(declare) declare(v4_bf16) declare(v4_amx)
