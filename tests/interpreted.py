"""Triton's kernels in tests: compiled where there is a GPU, else interpreted on the CPU, which needs tiny sizes."""

import inspect
import os

import pytest
import torch

HAS_GPU = torch.cuda.is_available()
if not HAS_GPU:
    os.environ.setdefault("TRITON_INTERPRET", "1")  # read when a kernel's module is loaded
triton = pytest.importorskip("triton", reason="needs triton, which the dev extra installs on Linux")

DEVICE = torch.device("cuda" if HAS_GPU else "cpu")

_jit = triton.jit
# The import hook that checks shapes (conftest.py) wraps every function, kernels too; Triton wants the kernel itself.
triton.jit = lambda kernel=None, **options: (
    _jit(inspect.unwrap(kernel)) if kernel else lambda kernel: _jit(inspect.unwrap(kernel), **options)
)
