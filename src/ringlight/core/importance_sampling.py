"""Which rows of a backward pass are computed: the reference of kernels/step/importance_sampling.isa.hpp.

A row is drawn with a chance in proportion to its upstream gradient, up to certainty, and what is drawn counts
1 / chance: the expectation is the whole gradient, most of which a few rows hold (importance sampling). Chances are laid
end to end and one is drawn at every unit from a random start (systematic sampling), which is made of the bits of the
gradients' sum.
"""

import functools
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

CERTAINTY = 1 << 32
"""Chances are counted in units of this, so that their sum is exact."""

MIXING = ((16, 0x7FEB352D), (15, 0x846CA68B), (16, 1))
"""Shifts and factors of Chris Wellons' lowbias32, a public-domain mixing of 32 bits."""


def importance_sampled(values: Float[Tensor, "K C"], share: float) -> Float[Tensor, "K C"]:
    """The values as they are. Backwards, at most ``share`` of the rows that have a gradient hand it on."""
    if share >= 1:
        return values
    drawn: Tensor = _ImportanceSampled.apply(values, share)
    return drawn


def importance_weights(gradient: Float[Tensor, "K C"], share: float) -> Float[Tensor, "K"]:
    """What each row counts: 0 if it was not drawn, else 1 / chance. Ones if a gradient is no finite number."""
    exact = gradient.float()
    sizes = functools.reduce(torch.add, exact.abs().unbind(-1))  # in the kernels' order
    with_gradient = int((sizes != 0).sum())
    certain = (sizes.double().sum() / (share * max(with_gradient, 1))).float()
    if not certain.isfinite():
        return torch.ones_like(sizes)
    chances = torch.where(sizes < certain, (sizes / certain * CERTAINTY).long(), CERTAINTY)
    chances = torch.where(sizes != 0, chances, 0)
    sums = chances.cumsum(0) + _random_start(certain)
    drawn = sums // CERTAINTY != (sums - chances) // CERTAINTY
    return torch.where(drawn, torch.where(sizes < certain, certain / sizes, 1.0), 0.0)


def _random_start(seed: Float[Tensor, ""]) -> int:
    """In [0, CERTAINTY), of the number's bits."""
    mixed = int(seed.view(torch.int32)) % CERTAINTY
    for shift, factor in MIXING:
        mixed = ((mixed ^ (mixed >> shift)) * factor) % CERTAINTY
    return mixed


class _ImportanceSampled(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, values: Tensor, share: float) -> Tensor:
        ctx.share = share
        return values.view_as(values)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None]:
        return gradient * importance_weights(gradient, ctx.share)[:, None].to(gradient), None
