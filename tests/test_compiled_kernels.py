"""Every Triton kernel compiles for a GPU, on any machine, and fits it."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import ringlight

PROGRAM = Path(__file__).with_name("compiled_kernels.py")

SOURCES = Path(ringlight.__file__).parent

ARCHITECTURE = 80

SHARED = 99 * 1024
"""Bytes of shared memory that a block may have on every NVIDIA GPU since 2020."""

SPILLED = 1024
"""Bytes a thread may spill: more would run from memory instead of registers."""


def launched_kernels() -> set[str]:
    """As "module.kernel", of the sources: what is under Triton's decorator and called with a grid."""
    found, texts = set(), {path.stem: path.read_text(encoding="utf-8") for path in SOURCES.glob("**/*.py")}
    for stem, text in texts.items():
        imported = re.findall(r"^from ringlight\.(?:\w+\.)*(\w+) import (.+)$", text, flags=re.MULTILINE)
        for kernel in re.findall(r"^ +(\w+)\[.+\]\(", text, flags=re.MULTILINE):
            homes = [stem, *(module for module, names in imported if kernel in names.split(", "))]
            jitted = re.compile(rf"^@triton\.jit.*\ndef {kernel}\(", re.MULTILINE)
            found |= {f"{home}.{kernel}" for home in homes if jitted.search(texts.get(home, ""))}
    return found


@pytest.mark.slow
def test_every_kernel_compiles_and_fits(tmp_path):
    pytest.importorskip("triton", reason="needs triton, which the dev extra installs on Linux")
    environment = {name: value for name, value in os.environ.items() if name != "TRITON_INTERPRET"}
    done = subprocess.run(
        [sys.executable, str(PROGRAM), str(ARCHITECTURE)],
        env=environment | {"TRITON_CACHE_DIR": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    kernels = [line.split() for line in done.stdout.splitlines()]
    assert {name for name, *_ in kernels} == launched_kernels()
    for name, _, shared, spilled in kernels:
        assert int(shared) <= SHARED, name
        assert spilled == "unknown" or int(spilled) <= SPILLED, name
