"""Bases in which a step of a tensor train's cores changes its entries about as much whichever numbers it moves.

A core's numbers count by what the cores before and behind it make of its indices. In few directions that is large, in
most of them small: Adam, which moves all numbers alike, is held back by the first and hardly moves along the others.
Scaled gradient descent (Tong, Ma, Chi 2021) divides a gradient by the Gram matrices of both sides, their squares. Here
Adam is left to do half of that: it sees gradients divided by the roots, and so are its steps.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.volume.products import by_columns, by_rows
from ringlight.volume.tensor_train import Cores

SMALLEST = 1e-30
"""Of a core's largest entry, that is divided by."""


@dataclass(frozen=True)
class Scaling:
    """Of a core's left and right index, symmetric; None leaves an index as it is."""

    left: Float[Tensor, "r r"] | None
    right: Float[Tensor, "s s"] | None

    def __call__(self, core: Float[Tensor, "r o s"]) -> Float[Tensor, "r o s"]:
        """A gradient in these bases, or a step from them: the map is its own transpose."""
        if self.left is not None:
            core = (self.left @ core.flatten(1)).view_as(core)
        return core if self.right is None else (core.flatten(0, 1) @ self.right).view_as(core)


@torch.no_grad()
def scalings(cores: Cores, share: float) -> list[Scaling]:
    """Of each core. ``share`` in [0, 1) of a Gram matrix counts beside one whose eigenvalues all are their mean: 0
    would leave steps as they are, and 1 divide by nearly nothing."""
    before, behind = _grams(cores), _grams([core.permute(2, 1, 0) for core in reversed(cores)])[::-1]
    return [
        Scaling(_inverse_root(left, share) if k else None, _inverse_root(right, share) if k < len(cores) - 1 else None)
        for k, (left, right) in enumerate(zip(before, behind, strict=True))
    ]


def _grams(cores: Cores) -> list[Tensor]:
    """Of what the cores before each make of its left index, over all paths and channels; mean eigenvalues are one."""
    gram = torch.eye(len(cores[0])).to(cores[0])
    found = []
    for core in cores:
        found.append(gram)
        core = core / core.abs().max().clamp_min(SMALLEST)  # squares of what a diverging run has would overflow
        rows = core.flatten(0, 1)
        gram = _even(by_rows(rows.T, by_columns(gram, core.flatten(1)).view_as(rows)))
    return found


def _even(gram: Float[Tensor, "r r"]) -> Float[Tensor, "r r"]:
    """Symmetric, and of mean eigenvalue one; the identity for one of zeros or of what is not finite."""
    mean = gram.diagonal().mean()
    if not (mean > 0 and gram.isfinite().all()):
        return torch.eye(len(gram)).to(gram)
    return (gram + gram.T) / (2 * mean)


def _inverse_root(gram: Float[Tensor, "r r"], share: float) -> Float[Tensor, "r r"]:
    """Of the mean of ``gram`` and the identity, weighted by ``share``."""
    values, vectors = torch.linalg.eigh(gram)
    return (vectors * (share * values.clamp_min(0) + (1 - share)).rsqrt()) @ vectors.T
