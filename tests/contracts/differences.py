"""Gradients held against finite differences, in float64, along random directions."""

from collections.abc import Callable, Mapping

import torch
from torch import Tensor

STEP = 1e-6
"""Of a direction of unit length; the error of a central difference is of its square."""
TOLERANCE = 3e-5
"""Of a leaf's own slope; what is left is rounding over twice the step."""
FLOOR = 1e-4
"""Of the largest slope of all leaves: a leaf whose slope is smaller is held against this much of it. All leaves
share the rounding of the value, 1e-16 of it over a step of 1e-6 some thirty times: 3e-9 of slopes as large as the
value, which is ``TOLERANCE`` of this floor and no less of anything below it."""


def slopes_differ(
    value: Callable[[], Tensor], leaves: Mapping[str, Tensor], gradients: Mapping[str, Tensor], seed: int = 0
) -> dict[str, float]:
    """By leaf, how far the slope by its gradient is from the difference of ``value`` along a random direction, as a
    share of the leaf's slope or of ``FLOOR``; the leaves are moved there and back in place."""
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
    return {name: abs(d - slope) / max(abs(d), abs(slope), FLOOR * largest) for name, (d, slope) in found.items()}
