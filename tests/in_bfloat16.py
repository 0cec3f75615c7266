"""Whether the light field's layers multiply in bfloat16 on this machine, where tolerances are those of eight bits.

``tests/test_isa.py`` runs the same tests with single precision, and their narrow tolerances, wherever a machine has it.
"""

from ringlight import _kernels

IN_BFLOAT16 = _kernels.isa() in ("avx512_bf16", "avx512_amx")

NEAR_KINKS = 0.4
"""Of a gradient's norm: hidden units near their kinks may be on the other side, and small networks have few others."""
