"""A tensor train of smaller ranks that is nearly the same: orthogonal from the left, then cut from the right.

Oseledets: Tensor-train decomposition, 2011, algorithm 2. The order of the sweeps is fixed, and so are the bits.
"""

import math

import torch
from torch import Tensor

from ringlight.volume.tensor_train import Cores


@torch.no_grad()
def rounded(cores: Cores, most: int) -> tuple[list[Tensor], float]:
    """Ranks up to ``most``, and the Euclidean distance of all entries from what they were.

    The distance is exact but for rounding of numbers: what one cut leaves out is orthogonal to what the others do.
    """
    swept = _orthogonal_from_left(cores)
    lost = 0.0
    for k in range(len(swept) - 1, 0, -1):
        core = swept[k]
        left, values, right = torch.linalg.svd(core.flatten(1), full_matrices=False)
        kept = min(most, len(values))
        lost += values[kept:].double().square().sum().item()
        swept[k] = right[:kept].reshape(kept, *core.shape[1:])
        swept[k - 1] = swept[k - 1] @ (left[:, :kept] * values[:kept])
    return _evened_out(swept), math.sqrt(lost)


def _orthogonal_from_left(cores: Cores) -> list[Tensor]:
    """The same entries; all cores but the last have orthonormal columns."""
    swept = [core.detach() for core in cores]
    for k in range(len(swept) - 1):
        core = swept[k]
        columns, rest = torch.linalg.qr(core.flatten(0, 1))
        swept[k] = columns.view(*core.shape[:2], -1)
        swept[k + 1] = (rest @ swept[k + 1].flatten(1)).view(len(rest), *swept[k + 1].shape[1:])
    return swept


def _evened_out(cores: list[Tensor]) -> list[Tensor]:
    """The same entries with cores of one root mean square, so that one learning rate suits all."""
    sizes = [core.double().square().mean().sqrt().item() for core in cores]
    if not all(sizes):
        return cores
    common = math.exp(sum(math.log(size) for size in sizes) / len(sizes))
    return [(core * (common / size)).contiguous() for core, size in zip(cores, sizes, strict=True)]
