"""Which samples pass the gradient of their colour on: half of those that have one weigh next to nothing."""

import torch
from jaxtyping import Float, Int
from torch import Tensor


def chosen_by_lot(
    weights: Float[Tensor, "S"], lot: float, jitter: Float[Tensor, "R"]
) -> tuple[Int[Tensor, "C"], Float[Tensor, "C"]]:
    """Numbers of those that do, rising, and what their gradients are multiplied by.

    A sample of weight w below ``lot`` is drawn with probability w / lot, and counts lot / w times: gradients keep their
    mean. The draw is a function of the rays' ``jitter``, and so of seed and step.
    """
    if not lot:
        return torch.arange(len(weights), device=weights.device), torch.ones_like(weights)
    seed = int(jitter[:1].view(torch.int32)) if len(jitter) else 0
    drawn = torch.rand(len(weights), generator=torch.Generator().manual_seed(seed)).to(weights.device)
    chance = (weights / lot).clamp_max(1)
    chosen = (drawn < chance).nonzero()[:, 0]
    return chosen, 1 / chance[chosen]


def with_gradient_by_lot(
    colors: Float[Tensor, "S 3"], weights: Float[Tensor, "S"], lot: float, jitter: Float[Tensor, "R"]
) -> Float[Tensor, "S 3"]:
    """The same colours, whose gradient is that."""
    chosen, factors = chosen_by_lot(weights, lot, jitter)
    shares = torch.zeros_like(weights).index_copy(0, chosen, factors)
    fixed = colors.detach()
    return fixed + (colors - fixed) * shares[:, None]
