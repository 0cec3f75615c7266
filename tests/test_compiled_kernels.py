"""Every Triton kernel compiles for a GPU, on any machine, and fits it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = Path(__file__).with_name("compiled_kernels.py")

ARCHITECTURE = 80

SHARED = 99 * 1024
"""Bytes of shared memory that a block may have on every NVIDIA GPU since 2020."""

SPILLED = 1024
"""Bytes a thread may spill: more would run from memory instead of registers."""


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
    assert len({name for name, *_ in kernels}) == 22
    for name, _, shared, spilled in kernels:
        assert int(shared) <= SHARED, name
        assert spilled == "unknown" or int(spilled) <= SPILLED, name
