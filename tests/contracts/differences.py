"""Gradients held against finite differences, in float64, along random directions."""

from collections.abc import Callable, Mapping

import torch
from torch import Tensor

STEP = 1e-6
"""Of a direction of unit length; the error of a central difference is of its square."""
TOLERANCE = 1e-5
"""Of the largest slope found; what is left is rounding over twice the step."""


def slopes_differ(
    value: Callable[[], Tensor], leaves: Mapping[str, Tensor], gradients: Mapping[str, Tensor], seed: int = 0
) -> dict[str, float]:
    """By leaf, how far the slope by its gradient is from the difference of ``value`` along a random direction, as a
    share of the largest slope; the leaves are moved there and back in place."""
    drawn = torch.Generator().manual_seed(seed)
    found: dict[str, tuple[float, float]] = {}
    with torch.no_grad():
        for name, leaf in leaves.items():
            direction = torch.randn(leaf.shape, generator=drawn, dtype=torch.float64)
            direction /= direction.norm().clamp_min(1e-12)
            usual = leaf.clone()
            ends = []
            for sign in (1, -1):
                leaf.copy_(usual + sign * STEP * direction)
                ends.append(value().item())
            leaf.copy_(usual)
            found[name] = ((ends[0] - ends[1]) / (2 * STEP), (gradients[name] * direction).sum().item())
    largest = max((abs(difference) for difference, _ in found.values()), default=1.0) or 1.0
    return {name: abs(difference - slope) / largest for name, (difference, slope) in found.items()}
