"""Gaussians that a training picture leaves out, so that none is relied on from one direction alone.

Dropout for splats (Park et al. 2025, "DropGaussian", there for few photographs): those left out have no opacity, the
others more, so that the mean of each opacity is kept. Ours draws them with one probability, late in a run.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.randomness import generator


@dataclass(frozen=True)
class LeftOut:
    """Of one step: each row with probability ``share``."""

    share: float
    seed: int
    step: int

    def factors(self, rows: int, device: torch.device) -> Float[Tensor, "N"]:
        """Of the opacities: 0, or 1 / (1 - share). A pure function of seed, step and number of rows."""
        draw = generator(self.seed, self.step, "dropout")
        kept = torch.empty(rows).bernoulli_(1 - self.share, generator=draw)
        return kept.div_(1 - self.share).to(device)


@dataclass(frozen=True)
class Dropout:
    """Of a run: ``share`` of the Gaussians, in (0, 1), at each step after ``after``."""

    share: float
    after: int

    def at(self, seed: int, step: int) -> LeftOut | None:
        """What this step leaves out; None for nothing."""
        return LeftOut(self.share, seed, step) if step > self.after else None
