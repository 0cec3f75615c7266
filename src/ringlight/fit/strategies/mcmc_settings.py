"""Settings of density control as Markov chain Monte Carlo. Torch-free: recipes hold these."""

import math
from dataclasses import dataclass, replace
from typing import Literal

from ringlight.core.later import later
from ringlight.errors import RecipeError
from ringlight.fit.rates import PAPER_STEPS

PAPER_EXTENT = 5.2
"""Extent of scenes of NeRF-Synthetic (lego 5.20, chair 5.25). The paper's noise and scale penalty are in world units:
taken relative to it, they do the same to a scene of any size."""

PAPER_PENALTY = 0.01
"""The paper's weight of each penalty, in runs of its 30,000 steps."""

GROWN_BY = 0.5
"""Share of the rounds by which the budget is met, if growth alone would not meet it sooner: what comes last learns
least."""


@dataclass(frozen=True)
class MCMCSettings:
    """3D Gaussian Splatting as Markov Chain Monte Carlo (Kheradmand et al. 2024), for --densify.kind mcmc."""

    dead: float = 0.01
    """A Gaussian of this opacity or less is dead, and moves in the next round. The paper has 0.005; what adds less than
    1/255 to a pixel is not drawn, and so has no gradient, and stays just above that."""
    stop: float = 5 / 6
    """Share of all steps after which none is moved or added; where some are dropped later, densify.stop is. A run
    without a round until then has one all the same, by which it meets its budget."""
    growth: float = 0.05
    """Share of the Gaussians that a round adds, until there are max_gaussians, or as many more as are dropped later;
    more where the rounds of the run's first half of density control would not reach that."""
    first_share: float = 0.2
    """The first round leaves this share of what the rounds add up to at most, those whose removal would change the
    pictures most: most random points show nothing, and the rest of the budget grows where it is missing. Give 1 where a
    run starts from a model."""
    draw: Literal["opacity", "gradient"] = later("opacity", now="gradient")
    """What copies are drawn in proportion to. opacity: that of each Gaussian, as in the paper. gradient: its mean
    screen-space gradient since the last round, by which adaptive density control finds where Gaussians are missing."""
    copies: Literal["alike", "parts"] = later("alike", now="parts")
    """alike: copies and what was copied together show what the one showed (the paper's equation 9). parts: each is as
    opaque as the one and 1/1.6 as wide, as 3DGS splits; for copies that move apart."""
    apart: float = later(0.0, now=1.0)
    """Standard deviations of a copy along each of its axes by which it is moved, times a normal number. The paper
    leaves copies in one place, and so does a short run then (docs/experiments/mcmc.md). 0: none."""
    noise: float = 5e5
    """Size of the noise on centres, times their learning rate and covariance. It holds for a scene whose extent is that
    of NeRF-Synthetic, and is scaled to that of others. 0: none."""
    opacity_penalty: float | None = None
    """Weight of the mean opacity in the loss. By default the paper's 0.01 in a run of its 30,000 steps or more, and as
    much less as a run is shorter."""
    scale_penalty: float | None = None
    """Weight of the mean standard deviation of the Gaussians in the loss, in the unit that noise has; by default
    likewise."""

    def __post_init__(self) -> None:
        for name in ("growth", "apart", "noise", "opacity_penalty", "scale_penalty"):
            value = getattr(self, name)
            if value is not None and not 0 <= value < math.inf:
                raise RecipeError(f"densify.mcmc.{name} is {value:g}; give 0 (none) or more")
        if not 0 <= self.dead < 1:
            raise RecipeError(f"densify.mcmc.dead is {self.dead:g}; give 0 (none) or more, below 1")
        if not 0 < self.first_share <= 1:
            raise RecipeError(f"densify.mcmc.first_share is {self.first_share:g}; give a share above 0, at most 1")
        if not 0 <= self.stop <= 1:
            raise RecipeError(f"densify.mcmc.stop is {self.stop:g}; give a share of all steps, from 0 to 1")

    def at_length(self, steps: int) -> "MCMCSettings":
        """The same with what is left to the run's length, ``steps``, decided."""
        usual = PAPER_PENALTY * min(steps / PAPER_STEPS, 1.0)
        of_opacity = usual if self.opacity_penalty is None else self.opacity_penalty
        of_scale = usual if self.scale_penalty is None else self.scale_penalty
        return replace(self, opacity_penalty=of_opacity, scale_penalty=of_scale)


USUAL_MCMC = MCMCSettings()
"""What a file means that knows none: nothing, for its density control is adaptive."""
