"""Whether Triton's kernels can serve some tensors: on a GPU."""

import functools
import importlib.util
import os

import torch
from torch import Tensor

SWITCH = "RINGLIGHT_TRITON"
"""Set to "0" for torch operations in place of our kernels, to tell which of both is wrong; to "bf16" for products of
bfloat16 numbers in networks, which are faster and round their factors to three digits."""

VARYING = ("count", "used", "width")
"""Arguments of kernels that change within a run: rows, harmonics in use, pixels a line. Left to itself Triton compiles
anew where one is a multiple of 16, or is 1: seconds a kernel, and gains nothing by it here."""


def runs_triton(*tensors: Tensor) -> bool:
    """Whether all, at least one, are float32 on one CUDA device, and Triton is installed."""
    if not tensors[0].is_cuda or os.environ.get(SWITCH) == "0" or not is_installed():
        return False
    fits = all(tensor.dtype == torch.float32 for tensor in tensors)
    return fits and len({tensor.device for tensor in tensors}) == 1


def multiplies_halves() -> bool:
    """Whether networks shall multiply bfloat16 numbers; sums stay in float32."""
    return os.environ.get(SWITCH) == "bf16"


@functools.cache
def is_installed() -> bool:
    """Whether there is a package ``triton``; looks without importing it."""
    found = importlib.util.find_spec("triton") is not None
    if found:  # multiply-adds as one: what Triton has always done, and warns of where nobody says so
        os.environ.setdefault("TRITON_DEFAULT_FP_FUSION", "1")
    return found
