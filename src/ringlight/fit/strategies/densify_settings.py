"""Settings of adaptive density control. Torch-free: recipes hold these."""

from dataclasses import dataclass, replace
from typing import Literal

from ringlight.core.later import later
from ringlight.errors import RecipeError
from ringlight.fit.rates import PAPER_STEPS

DROP_ROUNDS = 5
"""Rounds in which Gaussians are dropped. Between them the others fill the gaps: all at once costs 0.1 dB on chair_400
after 3,000 steps."""

PAPER_BEGIN = 500
"""3DGS's first step of density control."""

BEGIN_SHARE = 10
"""In runs of under 5,000 steps it begins after a tenth of them: 1.8 dB on chair_400 after 1,000 steps."""

FEWEST_GROWTHS = 5
"""With fewer rounds of density control nothing is dropped: most Gaussians are still the first ones then."""


@dataclass(frozen=True)
class DensifySettings:
    """Adaptive density control (3DGS, section 5.2)."""

    threshold: float = 2e-4
    """A Gaussian is cloned or split if its mean screen-space gradient, dL/d(NDC position), exceeds this."""
    begin: int | None = None
    """Gaussians are added after this step. By default 500 as in 3DGS, or a tenth of the run if that is less."""
    stop: float = 0.5
    """Share of all steps after which no Gaussians are added."""
    latest: int = 15_000
    """No Gaussians are added after this step, however long the run."""
    every: int = 100
    """Steps between two rounds."""
    clone_below: float = 0.01
    """Gaussians up to this share of the scene's extent are cloned; wider ones are split."""
    prune_opacity: float = 0.005
    """Fainter Gaussians are removed."""
    prune_scale: float = 0.1
    """After the first opacity reset, Gaussians wider than this share of the scene's extent are removed."""
    reset_every: int = 3000
    """Steps between two opacity resets; 0 never resets."""
    reset_opacity: float = 0.01
    """A reset lowers opacities to this."""
    in_proportion: bool = later(False)
    """Whether begin, reset_every and the reset over white are steps of a run of 30,000, and come as much earlier as a
    run is shorter. Without it they are steps of any run, as in 3DGS."""
    max_gaussians: int = 0
    """Most Gaussians at the end of density control, unless it began with more and drops none. The largest gradients
    come first. 0 takes as many as a training photograph has pixels, since no view could tell more apart. Where a
    subject is cut out, ringlight-mirror takes one for every seven pixels, but at least 10,000 if there are as many
    pixels."""
    pixel_bound: bool = later(True)
    """Whether max_gaussians of 0 takes the photographs' pixels. Without it 0 is no bound, as in 3DGS: a run ends with
    an error once they need more than half of the machine's memory."""
    drop_share: float = 0.0
    """Share of the Gaussians that is dropped once no more are added: those that add least to the training photographs.
    Until then there may be max_gaussians / (1 - drop_share). 0 keeps all, as 3DGS does."""
    drop_until: float = 0.75
    """Share of all steps at which the last Gaussians are dropped."""
    drop_by: Literal["weights", "effects"] = later("weights")
    """What a Gaussian adds. weights: its blending weights, added up. effects: the squared change of the pictures if it
    were gone; where its neighbours have its colour that is little."""

    def __post_init__(self) -> None:
        for name, least in {"begin": 0, "latest": 0, "every": 1, "reset_every": 0, "max_gaussians": 0}.items():
            if (getattr(self, name) or 0) < least:
                raise RecipeError(f"densify.{name} is {getattr(self, name)}; give at least {least}")
        for name in ("threshold", "clone_below", "prune_scale"):
            if not getattr(self, name) >= 0:
                raise RecipeError(f"densify.{name} is {getattr(self, name):g}; give 0 or more")
        if not 0 <= self.drop_share < 1:
            raise RecipeError(f"densify.drop_share is {self.drop_share:g}; give 0 (keep all) or more, below 1")
        if not 0 <= self.drop_until <= 1:
            raise RecipeError(f"densify.drop_until is {self.drop_until:g}; give a share of all steps, from 0 to 1")
        if not 0 <= self.stop <= 1:
            raise RecipeError(f"densify.stop is {self.stop:g}; give a share of all steps, from 0 to 1")
        if not 0 < self.reset_opacity < 1:
            raise RecipeError(f"densify.reset_opacity is {self.reset_opacity}; an opacity lies between 0 and 1")
        if not 0 <= self.prune_opacity < 1:
            raise RecipeError(f"densify.prune_opacity is {self.prune_opacity}; give 0 (keep all) or more, below 1")

    def at_length(self, steps: int) -> "DensifySettings":
        """The same with what is left to the run's length, ``steps``, decided."""
        if self.begin is not None:
            return self
        return replace(self, begin=PAPER_BEGIN if self.in_proportion else self.first_step(steps))

    def first_step(self, steps: int) -> int:
        """The step after which rows may be added."""
        if self.begin is None and not self.in_proportion:
            return min(PAPER_BEGIN, steps // BEGIN_SHARE)
        return self.paced(PAPER_BEGIN if self.begin is None else self.begin, steps)

    def paced(self, step: int, steps: int) -> int:
        """``step`` of a run of 30,000 in one of ``steps``, if they are in proportion; zero alone stays zero."""
        if not self.in_proportion or not step:
            return step
        return max(round(step * min(steps / PAPER_STEPS, 1.0)), 1)

    def within(self, pixels: int) -> "DensifySettings":
        """These settings with a bound that is a number, unless they want none; ``pixels`` are those of the largest
        training photograph."""
        return self if self.max_gaussians or not self.pixel_bound else replace(self, max_gaussians=pixels)

    def most_growing(self, steps: int) -> int:
        """The bound until Gaussians are dropped, in a run of so many ``steps``; 0 where there is none."""
        return int(self.max_gaussians / (1 - self.drop_share)) if self.drop_rounds(steps) else self.max_gaussians

    def drop_rounds(self, steps: int) -> frozenset[int]:
        """The steps after which Gaussians are dropped; none in runs too short to have grown what could be spared, nor
        where density control goes on to the end."""
        last, until = self.last_step(steps), int(self.drop_until * steps)
        if not self.drop_share or last // self.every - self.first_step(steps) // self.every < FEWEST_GROWTHS:
            return frozenset()
        rounds = [last + 1 + index * max(until - last, 0) // DROP_ROUNDS for index in range(DROP_ROUNDS)]
        return frozenset(rounds) if max(rounds) <= steps else frozenset()

    def last_step(self, steps: int) -> int:
        """The last step at which rows may be added."""
        return min(self.latest, int(self.stop * steps))
