"""Steps of a tensor train's core along near-orthogonal matrices: whatever a mean gradient tells counts about as much.

Muon (Jordan et al. 2024) steps a matrix along the nearest matrix whose singular values all are one, found by Newton and
Schulz's iteration from the mean of its gradients. A core is two matrices, of its left index by all others and of its
right one likewise; it steps along the sum of both.
"""

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


@torch.no_grad()
def orthogonal_direction(mean: Float[Tensor, "r o s"]) -> Float[Tensor, "r o s"]:
    """Of root mean square STEP_SIZE, whatever the size of ``mean``, of which all numbers are finite; zeros for zeros.

    Both matrices count alike: each is brought to one root mean square before they are added.
    """
    of_left = _even(near_orthogonal(mean.flatten(1))).view_as(mean)
    of_right = _even(near_orthogonal(mean.flatten(0, 1))).view_as(mean)
    return STEP_SIZE * _even(of_left + of_right)


def near_orthogonal(matrix: Float[Tensor, "r s"]) -> Float[Tensor, "r s"]:
    """The matrix with singular values between 0.4 and 1.3, those below 0.001 of its norm with smaller ones.

    Each iteration multiplies it from its shorter side by a polynomial of its Gram matrix there. So these are multiplied
    with each other first, and with the matrix, which is about eight times as long, once.
    """
    if len(matrix) > matrix.shape[1]:
        return near_orthogonal(matrix.T).T
    matrix = matrix / matrix.abs().max().clamp_min(SMALLEST)  # squares of what is tiny or huge would not be floats
    matrix = matrix / matrix.norm().clamp_min(SMALLEST)
    gram = matrix @ matrix.T
    through = factor = _factor(gram)
    for _ in range(ITERATIONS - 1):
        gram = factor @ gram @ factor
        gram = (gram + gram.T) / 2
        factor = _factor(gram)
        through = factor @ through
    return through @ matrix


def _factor(gram: Float[Tensor, "r r"]) -> Float[Tensor, "r r"]:
    """What an iteration multiplies a matrix of this Gram matrix by."""
    factor = CUBIC * gram + QUINTIC * (gram @ gram)
    factor.diagonal().add_(LINEAR)
    return factor


def near_orthogonal_reference(matrix: Float[Tensor, "r s"]) -> Float[Tensor, "r s"]:
    """The same as Muon has it: each iteration multiplies the whole matrix."""
    found = matrix / matrix.norm().clamp_min(SMALLEST)
    for _ in range(ITERATIONS):
        gram = found @ found.T
        found = LINEAR * found + (CUBIC * gram + QUINTIC * (gram @ gram)) @ found
    return found


def _even(tensor: Tensor) -> Tensor:
    """Of root mean square one, or zeros."""
    return tensor / tensor.square().mean().sqrt().clamp_min(SMALLEST)
