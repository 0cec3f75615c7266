"""Refuses object files whose code the linker might merge with code compiled for another instruction set.

A function that two object files define under one weak name (a template of the standard library, say) ends up once in
the module: the AVX-512 copy would crash an AVX2 machine. So all that kernels/*/*.isa.cpp define must lie in the
namespace of their instruction set.

    python check_isa_symbols.py NM ISA OBJECT...
"""

import subprocess
import sys

CODE = "TtWwi"
"""Types of `nm` that are code: text, weak, indirect. Lower case `t` is local and cannot be merged."""


def shared_code(listing: str, isa: str) -> list[str]:
    """Mangled names of code with external linkage outside ``ringlight::isa``, from the output of ``nm``."""
    mangled = f"9ringlight{len(isa)}{isa}"
    fields = (line.split() for line in listing.splitlines())
    defined = [(line[-2], line[-1]) for line in fields if len(line) == 3]
    return sorted({name for kind, name in defined if kind in CODE and kind != "t" and mangled not in name})


def main(nm: str, isa: str, *objects: str) -> int:
    answer = subprocess.run([nm, "--defined-only", *objects], check=True, capture_output=True, text=True)
    shared = shared_code(answer.stdout, isa)
    for name in shared:
        sys.stderr.write(f"{name} is defined for {isa} but not in its namespace; keep it out of *.isa.cpp\n")
    return 1 if shared else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
