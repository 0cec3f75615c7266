"""Whether Triton's kernels can serve some tensors: on a GPU."""

import functools
import importlib.util
import os

import torch
from torch import Tensor

OFF = "RINGLIGHT_TRITON"
"""Set to "0" for torch operations in place of our kernels: to tell which of both is wrong."""


def runs_triton(*tensors: Tensor) -> bool:
    """Whether all are float32 on one CUDA device, and Triton is installed."""
    if os.environ.get(OFF) == "0" or not is_installed():
        return False
    fits = all(tensor.dtype == torch.float32 for tensor in tensors)
    return fits and len({tensor.device for tensor in tensors}) == 1 and tensors[0].is_cuda


@functools.cache
def is_installed() -> bool:
    """Whether there is a package ``triton``; looks without importing it."""
    return importlib.util.find_spec("triton") is not None
