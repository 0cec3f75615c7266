"""Steps of a tensor train's core along near-orthogonal matrices: whatever a mean gradient tells counts about as much.

Muon (Jordan et al. 2024) steps a matrix along the nearest matrix whose singular values all are one, found by Newton and
Schulz's iteration from the mean of its gradients. A core is two matrices, of its left index by all others and of its
right one likewise; it steps along the sum of both.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

ITERATIONS = 5
"""Muon's. Singular values from 0.001 of a matrix's norm on come to lie between 0.4 and 1.3."""

LINEAR, CUBIC, QUINTIC = 3.4445, -4.7750, 2.0315
"""Muon's odd polynomial, which grows small singular values fast and does not come to rest at one."""

STEP_SIZE = 0.2
"""Root mean square of a step in units of the rate: about that of Adam's, so that one rate suits both (Liu et al. 2025,
"Muon is scalable for LLM training", section 2.2)."""

MOMENTUM = 0.95
"""Of the running mean whose direction is taken. Muon has as much, and looks one step ahead, which is left away here;
0.98 learned no more on one scene (docs/experiments/putt.md)."""

SMALLEST = 1e-30
"""Of what is divided by."""


@dataclass(frozen=True)
class InverseRoots:
    """What the mean gradient of a core of this shape is multiplied by: near-inverse roots of the Gram matrices of its
    two matrices, symmetric, each on the shorter side of its matrix.

    They may be of a mean some steps earlier (docs/experiments/putt.md).
    """

    of_left: Float[Tensor, "a a"]
    of_right: Float[Tensor, "b b"]

    def __call__(self, mean: Float[Tensor, "r o s"]) -> Float[Tensor, "r o s"]:
        """A direction of root mean square STEP_SIZE, whatever the size of ``mean``, of which all numbers are finite;
        zeros for zeros. Both matrices count alike: each is brought to one root mean square before they are added."""
        mean = _of_size_one(mean)
        of_left = _even(_multiplied(self.of_left, mean.flatten(1))).view_as(mean)
        of_right = _even(_multiplied(self.of_right, mean.flatten(0, 1))).view_as(mean)
        return STEP_SIZE * _even(of_left + of_right)


@torch.no_grad()
def inverse_roots(mean: Float[Tensor, "r o s"]) -> InverseRoots:
    """Of this mean, of which all numbers are finite. Those of zeros leave a later mean's direction as it is."""
    return InverseRoots(near_inverse_root(mean.flatten(1)), near_inverse_root(mean.flatten(0, 1)))


def near_inverse_root(matrix: Float[Tensor, "r s"]) -> Float[Tensor, "a a"]:
    """By this, from its shorter side, a matrix is multiplied to have singular values between 0.4 and 1.3 times its
    norm, those below 0.001 of its norm smaller ones.

    Each of Muon's iterations multiplies it by a polynomial of its Gram matrix there. So these are multiplied with each
    other, and the matrix, which is about eight times as long, is left out.
    """
    if len(matrix) > matrix.shape[1]:
        return near_inverse_root(matrix.T)
    matrix = _of_size_one(matrix)
    matrix = matrix / matrix.norm().clamp_min(SMALLEST)
    gram = matrix @ matrix.T
    through = factor = _factor(gram)
    for _ in range(ITERATIONS - 1):
        gram = factor @ gram @ factor
        gram = (gram + gram.T) / 2
        factor = _factor(gram)
        through = factor @ through
    return through


def _multiplied(root: Float[Tensor, "a a"], matrix: Float[Tensor, "r s"]) -> Float[Tensor, "r s"]:
    """From its shorter side."""
    return matrix @ root if len(matrix) > matrix.shape[1] else root @ matrix


def _factor(gram: Float[Tensor, "r r"]) -> Float[Tensor, "r r"]:
    """What an iteration multiplies a matrix of this Gram matrix by."""
    factor = CUBIC * gram + QUINTIC * (gram @ gram)
    factor.diagonal().add_(LINEAR)
    return factor


def near_orthogonal_reference(matrix: Float[Tensor, "r s"]) -> Float[Tensor, "r s"]:
    """A matrix over its norm times its near-inverse root, as Muon has it: each iteration multiplies all of it."""
    found = matrix / matrix.norm().clamp_min(SMALLEST)
    for _ in range(ITERATIONS):
        gram = found @ found.T
        found = LINEAR * found + (CUBIC * gram + QUINTIC * (gram @ gram)) @ found
    return found


def _of_size_one(tensor: Tensor) -> Tensor:
    """Its largest entry: squares of what is tiny or huge would not be floats."""
    return tensor / tensor.abs().max().clamp_min(SMALLEST)


def _even(tensor: Tensor) -> Tensor:
    """Of root mean square one, or zeros."""
    return tensor / tensor.square().mean().sqrt().clamp_min(SMALLEST)
