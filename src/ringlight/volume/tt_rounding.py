"""A tensor train of smaller ranks that is nearly the same: orthogonal from the left, then cut from the right.

Oseledets: Tensor-train decomposition, 2011, algorithm 2. The order of the sweeps is fixed, and so are the bits.
"""

import math

import torch
from torch import Tensor

from ringlight.volume.tensor_train import Cores

LARGEST_EXPONENT = 120
"""Of a power of two by which a core is divided: its inverse is a float32 with all its bits."""


@torch.no_grad()
def rounded(cores: Cores, most: int) -> tuple[list[Tensor], float]:
    """Ranks up to ``most``, and the Euclidean distance of all entries from what they were.

    The distance is exact but for rounding of numbers: what one cut leaves out is orthogonal to what the others do.
    """
    exponents = [_exponent(core) for core in cores]
    # Products of these stay far from the largest float, and powers of two leave the bits as they are.
    swept = _orthogonal_from_left([core.detach() * 2.0**-e for core, e in zip(cores, exponents, strict=True)])
    lost = 0.0
    for k in range(len(swept) - 1, 0, -1):
        core = swept[k]
        left, values, right = torch.linalg.svd(core.flatten(1), full_matrices=False)
        kept = min(most, len(values))
        lost += values[kept:].double().square().sum().item()
        swept[k] = right[:kept].reshape(kept, *core.shape[1:])
        swept[k - 1] = swept[k - 1] @ (left[:, :kept] * values[:kept])
    distance = math.sqrt(lost)
    for exponent in exponents:
        distance *= 2.0**exponent
    return _evened_out(swept, sum(exponents)), distance


def _exponent(core: Tensor) -> int:
    """The power of two just above its largest entry's size, or one that is near enough."""
    largest = core.detach().abs().max().item()
    return max(-LARGEST_EXPONENT, min(math.frexp(largest)[1], LARGEST_EXPONENT))


def _orthogonal_from_left(cores: Cores) -> list[Tensor]:
    """The same entries; all cores but the last have orthonormal columns."""
    swept = list(cores)
    for k in range(len(swept) - 1):
        core = swept[k]
        columns, rest = torch.linalg.qr(core.flatten(0, 1))
        swept[k] = columns.view(*core.shape[:2], -1)
        swept[k + 1] = (rest @ swept[k + 1].flatten(1)).view(len(rest), *swept[k + 1].shape[1:])
    return swept


def _evened_out(cores: list[Tensor], exponent: int) -> list[Tensor]:
    """The same entries times two to that power, with cores of one root mean square, so that one learning rate suits
    all."""
    sizes = [core.double().square().mean().sqrt().item() for core in cores]
    if not all(sizes):
        return cores
    common = math.exp((sum(math.log(size) for size in sizes) + exponent * math.log(2)) / len(sizes))
    return [(core * (common / size)).contiguous() for core, size in zip(cores, sizes, strict=True)]
