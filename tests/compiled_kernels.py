"""Compiles every Triton kernel for GPUs, which needs none; a program, since tests have kernels interpreted.

``python tests/compiled_kernels.py 80 90`` compiles for sm_80 and sm_90 and prints a line a kernel: name, architecture,
bytes of shared memory, bytes of stack that a thread spills to.
"""

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from types import ModuleType
from typing import Any

os.environ.setdefault("TRITON_DEFAULT_FP_FUSION", "1")

import triton
from triton.backends.compiler import GPUTarget
from triton.compiler import ASTSource

from ringlight.color import drawable_triton, harmonics_triton, mirror_triton, shared_basis_triton
from ringlight.fields import octahedral_triton, perceptron_triton, ring_triton
from ringlight.fit import adam_triton
from ringlight.fit.losses import photometric_triton
from ringlight.rasterize import stored_form_triton
from ringlight.shade import reflection_triton

INTEGERS = {"height", "step_y", "step_x", "step_c", "count", "nodes", "side", "slab", "stride", "width", "step", "used"}
ADDRESSES = {"levels", "gradients", "tensors"}
"""Tables of pointers; ``gradients`` of the maps."""
FLOATS = {"pixel_weight", "ssim_weight", "near", "log_reach", "farthest", "shortest", "least", "flip_below"}
FLOATS |= {"faintest_normal", "least_chord", "smallest", "from_x", "from_y", "from_z", "z_x", "z_y", "z_z", "z_0"}
OTHERS = {"sides": "*i32", "starts": "*i32", "left": "*i32", "marks": "*i8", "pixels": "*i64"}

EXACT, WIDE = dict(INPUTS=32, HIDDEN=64, OUTPUTS=3), dict(WIDE_INPUTS=32, WIDE_HIDDEN=64, WIDE_OUTPUTS=16)
DEEP = EXACT | WIDE | dict(DEEP=True, HALF=False, B=perceptron_triton.ROWS)
FLAT = DEEP | dict(DEEP=False, HIDDEN=128, WIDE_HIDDEN=128)
SIZES = dict(REACH=5, SIZE=photometric_triton.BLOCK)
RING = dict(RANK=8, WIDTH=8, B=ring_triton.ROWS)
MAPS = dict(WIDTH=4, PADDED=4, B=octahedral_triton.ROWS)
HARMONICS = dict(USED=15, ALL=15, B=harmonics_triton.BLOCK)
BASIS = dict(SIZE=8, WIDE=32, ALL=15, MOVES=True, B=shared_basis_triton.ROWS)
SURFACE = dict(LATENTS=4, B=mirror_triton.BLOCK)
MIRROR = dict(LATENTS=4, SHELLS=1, LEVELS=5, FEATURES=4, WIDE=4, PARALLAX=1, NODES=16, DEPTH=1, RAW=0)
MIRROR |= dict(B=reflection_triton.ROWS)
ACTIVE = dict(FACTOR=True, B=stored_form_triton.BLOCK)

KERNELS: list[tuple[ModuleType, str, dict[str, Any]]] = [
    (photometric_triton, "_along_rows", SIZES),
    *((photometric_triton, "_compare", SIZES | dict(SQUARED=squared, C1=1e-4, C2=9e-4)) for squared in (True, False)),
    (photometric_triton, "_slopes_along_rows", SIZES),
    *((photometric_triton, "_gradient", SIZES | dict(SQUARED=squared)) for squared in (True, False)),
    *((adam_triton, "_adam", dict(ROWS=rows, SIZE=adam_triton.BLOCK)) for rows in (True, False)),
    *((ring_triton, name, ring) for name in ("_ring_product", "_ring_product_gradient")
      for ring in (RING, RING | dict(RANK=16, WIDTH=16))),
    (octahedral_triton, "_read_maps", MAPS),
    (octahedral_triton, "_read_maps_gradient", MAPS),
    *((perceptron_triton, name, layers) for name in ("_forward", "_backward")
      for layers in (DEEP, FLAT, DEEP | dict(HALF=True))),
    (harmonics_triton, "_colors", HARMONICS),
    (harmonics_triton, "_gradient", HARMONICS),
    (shared_basis_triton, "_emit", BASIS | dict(LOGITS=False)),
    (shared_basis_triton, "_emit_gradient", BASIS | dict(LOGITS=True)),
    *((mirror_triton, name, SURFACE) for name in ("_surface", "_surface_gradient")),
    (reflection_triton, "read_surface", MIRROR),
    (reflection_triton, "read_surface_gradient", MIRROR | dict(PADDED=16)),
    (drawable_triton, "_drawable", dict(B=drawable_triton.BLOCK)),
    (stored_form_triton, "_activate", ACTIVE),
    (stored_form_triton, "_activate_gradient", ACTIVE),
]  # fmt: skip


def main(architectures: list[int]) -> None:
    for module, name, constants in KERNELS:
        kernel = getattr(module, name)
        options = getattr(module, "LAUNCH", {})
        for architecture in architectures:
            names = kernel.arg_names
            source = ASTSource(
                fn=kernel,
                signature={argument: _type(argument, module, constants) for argument in names},
                constexprs={(names.index(argument),): value for argument, value in constants.items()},
            )
            made = triton.compile(source, target=GPUTarget("cuda", architecture, 32), options=options)
            label = f"{module.__name__.rsplit('.', 1)[-1]}.{name}"
            sys.stdout.write(f"{label} {architecture} {made.metadata.shared} {_stack(made.asm['cubin'])}\n")


def _type(argument: str, module: ModuleType, constants: dict[str, Any]) -> str:
    if argument in constants:
        return "constexpr"
    if argument in ADDRESSES and module in (octahedral_triton, adam_triton):
        return "*i64"
    if argument in OTHERS:
        return OTHERS[argument]
    return "i32" if argument in INTEGERS else "fp32" if argument in FLOATS else "*fp32"


def _stack(binary: bytes) -> str:
    """Bytes that a thread spills, by cuobjdump where Triton brings it."""
    program = Path(triton.__file__).parent / "backends" / "nvidia" / "bin" / "cuobjdump"
    if not program.is_file():
        return "unknown"
    with tempfile.NamedTemporaryFile(suffix=".cubin") as file:
        file.write(binary)
        file.flush()
        told = subprocess.run([program, "-res-usage", file.name], capture_output=True, text=True, check=False).stdout
    found = re.search(r"STACK:(\d+)", told)
    return found[1] if found else "unknown"


if __name__ == "__main__":
    main([int(word) for word in sys.argv[1:]])
