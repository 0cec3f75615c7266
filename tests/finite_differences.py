"""Gradients against finite differences along random directions: two evaluations an input, not two a number of it."""

from collections.abc import Callable, Sequence

import torch
from torch import Tensor

STEP = 1e-6
"""Of a direction of length one, in float64."""

RELATIVE = 1e-5
"""Of both lengths: a gradient of a thousand numbers of which one is missing is off by some 1e-3."""

ROUNDING = 1e-9
"""Of the function's values: what STEP leaves of float64's digits."""


def assert_gradients(function: Callable[..., Tensor], inputs: Sequence[Tensor], seed: int = 0) -> None:
    """``function`` of ``inputs``, in float64, has the gradients that autograd finds, for one random sum of its values.

    Each input that requires a gradient is moved alone, along one random direction through all its numbers.
    """
    drawn = torch.Generator().manual_seed(seed)
    moved = [leaf for leaf in inputs if leaf.requires_grad]
    values = function(*inputs)
    upstream = torch.randn(values.shape, generator=drawn, dtype=values.dtype)
    found = torch.autograd.grad(values, moved, upstream, allow_unused=True, materialize_grads=True)
    rounding = ROUNDING * float((values.abs() * upstream.abs()).sum().detach())
    for number, (leaf, gradient) in enumerate(zip(moved, found, strict=True)):
        direction = torch.randn(leaf.shape, generator=drawn, dtype=leaf.dtype)
        direction /= direction.norm()

        def along(length: float, leaf: Tensor = leaf, direction: Tensor = direction) -> float:
            """The sum with this input moved so far, in place: the function may also know it by another way."""
            kept = leaf.clone()
            leaf.copy_(kept + length * direction)
            total = float((function(*inputs) * upstream).sum())
            leaf.copy_(kept)
            return total

        with torch.no_grad():
            expected = (along(STEP) - along(-STEP)) / (2 * STEP)
        difference = abs(expected - float((gradient * direction).sum()))
        assert difference <= RELATIVE * float(gradient.norm()) + rounding, (number, tuple(leaf.shape), difference)
