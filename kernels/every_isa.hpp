// The namespaces that hold a copy of every kernel, one per instruction set (dispatch.hpp says which one runs).
#pragma once

// declare(namespace) for each of them.
#define RINGLIGHT_EVERY_ISA(declare) declare(generic) declare(v3) declare(v4)
