"""Features that a neural light gives to what it lights, and how many of them say nothing any more.

A feature says nothing where it is the same for all Gaussians and directions, and cannot learn where it is held at the
end of its range. A light of which most features are so has collapsed: what it shows is little more than base colours.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

FLAT_ABOVE = 0.99
"""A tanh beyond this passes on less than a fiftieth of its gradient: 1 - 0.99^2."""

NEARLY_ALL = 0.99
"""Share of the samples at which a feature is flat, and counts as saturated, or a unit is zero, and counts as off. Not
all: what a hundredth of the samples learn does not bring the others back."""

LEAST_VARIATION = 0.01
"""A feature whose standard deviation is a smaller share than this of its root mean square counts as constant: 255
steps of colour hardly show a hundredth. A share, since features of maps have no scale of their own."""

MOST_SAMPLES = 4096
"""Of one view, evenly spread: a share of a hundredth is then of forty samples."""


@dataclass(frozen=True)
class LightFeatures:
    """Feature c at sample s, as the network behind it sees it, and whether it is ``flat`` there: at an end of its
    range, where hardly any gradient passes. ``hidden`` are the units of this network, after their ReLU. Samples are
    Gaussians or pixels that one view shows."""

    values: Float[Tensor, "S C"]
    flat: Bool[Tensor, "S C"]
    hidden: Float[Tensor, "S U"]


@dataclass(frozen=True)
class FeatureShares:
    """Shares of a light's features, 0 to 1; one that is held at one end of its range counts among both. ``off`` is the
    share of the hidden units of the network behind them that are zero at nearly all samples: they pass nothing on, nor
    back. Some are so when they are drawn."""

    saturated: float
    constant: float
    off: float


def flat_tanh(values: Float[Tensor, "S C"]) -> Bool[Tensor, "S C"]:
    """Which values of a tanh lie at its ends."""
    return values.abs() > FLAT_ABOVE


def evenly(count: int, most: int = MOST_SAMPLES) -> Int[Tensor, "S"]:
    """Indices of ``most`` of so many rows, or of all if they are fewer, evenly spread."""
    taken = min(count, most)
    return torch.arange(taken) * count // max(taken, 1)


def shares_of(views: Sequence[LightFeatures]) -> FeatureShares | None:
    """Of the features over all samples of several views; None where there is no sample or no feature."""
    values = torch.cat([view.values for view in views]).double() if views else torch.zeros(0, 0)
    if values.numel() == 0:
        return None
    flat = torch.cat([view.flat for view in views]).double().mean(0)
    zero = torch.cat([view.hidden == 0 for view in views]).double().mean(0)
    constant = values.std(0, correction=0) <= LEAST_VARIATION * values.square().mean(0).sqrt()
    saturated, off = flat >= NEARLY_ALL, zero >= NEARLY_ALL
    return FeatureShares(*(marks.double().mean().item() for marks in (saturated, constant, off)))
