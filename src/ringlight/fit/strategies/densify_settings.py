"""Settings of adaptive density control. Torch-free: recipes hold these."""

import math
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

from ringlight.core.later import later
from ringlight.errors import RecipeError
from ringlight.fit.rates import PAPER_STEPS, between, how_long
from ringlight.fit.strategies.mcmc_settings import USUAL_MCMC, MCMCSettings

DROP_ROUNDS = 5
"""Rounds in which Gaussians are dropped. Between them the others fill the gaps: all at once costs 0.1 dB on chair_400
after 3,000 steps."""

PAPER_BEGIN = 500
"""3DGS's first step of density control."""

BEGIN_SHARE = 10
"""In runs of under 5,000 steps it begins after a tenth of them: 1.8 dB on chair_400 after 1,000 steps."""

PAPER_CLONE_BELOW = 0.01
"""3DGS's share of the scene's extent up to which a Gaussian is copied into its own place. In shorter runs all are
split: 0.2 to 0.6 dB more for 3dgs on matte scenes after 3,000 steps, with as many Gaussians
(docs/experiments/growing-and-dropping.md)."""

PIXELS_PER_GAUSSIAN = 4
"""With mcmc, which ends with the bound itself; adaptive control seldom comes near one a pixel (3dgs, 3,000 steps: one
for 4 pixels of chair_400, for 2.6 of lego_400)."""

OF_ADAPTIVE = (
    *("threshold", "clone_below", "prune_opacity", "prune_scale"),
    *("reset_every", "reset_opacity", "pixel_bound"),
)
"""Settings that decide nothing with mcmc."""

OF_RESETS = ("reset_opacity", "prune_scale")
"""Settings that decide nothing without opacity resets: wide Gaussians are removed from the first on, as in 3DGS."""

OF_DROPPING = ("drop_until", "drop_by", "drop_hidden")
"""Settings that decide nothing where nothing is dropped."""

FEWEST_GROWTHS = 5
"""With fewer rounds of density control nothing is dropped: most Gaussians are still the first ones then."""


class Growth(NamedTuple):
    """How readily Gaussians are added, and which shares of them are dropped again: those that add least, and then
    those that lie hidden."""

    threshold: float
    drop_share: float
    drop_hidden: float


SHORT_GROWTH = Growth(threshold=1e-4, drop_share=0.7, drop_hidden=0.0)
"""In runs of SHORT_STEPS, and in shorter ones, most Gaussians are dropped again. Models take about a third of the
bytes of 3dgs; a larger share would gain as much again in bytes, at a tenth more time
(docs/experiments/growing-and-dropping.md). To drop what lies hidden too gains nothing (docs/experiments/hidden.md)."""

LONG_GROWTH = Growth(threshold=2e-4, drop_share=0.4, drop_hidden=0.01)
"""In runs as long as 3DGS's. There are five times as many rounds of growing: what suits short runs grows three
Gaussians a pixel before the first is dropped, for a step four times as long (docs/experiments/results.md). Long
runs let large Gaussians grow where no photograph sees them, too (docs/experiments/hidden.md)."""


def growth_at(steps: int) -> Growth:
    """What suits a run of so many ``steps``: from short to long ones, even in their logarithm."""
    share = how_long(steps)

    def mean(short: float, long: float) -> float:
        return (1 - share) * short + share * long

    return Growth(
        threshold=between(SHORT_GROWTH.threshold, LONG_GROWTH.threshold, share),
        drop_share=mean(SHORT_GROWTH.drop_share, LONG_GROWTH.drop_share),
        drop_hidden=mean(SHORT_GROWTH.drop_hidden, LONG_GROWTH.drop_hidden),
    )


@dataclass(frozen=True)
class DensifySettings:
    """Density control: adaptive (3DGS, section 5.2), or as Markov chain Monte Carlo."""

    kind: Literal["adaptive", "mcmc"] = later("adaptive")
    """adaptive: Gaussians are cloned, split and removed by their gradients and opacities, as in 3DGS. mcmc: as many as
    max_gaussians says; dead ones move to where others are, and faint ones wander (Kheradmand et al. 2024)."""
    threshold: float | None = 2e-4
    """A Gaussian is cloned or split if its mean screen-space gradient, dL/d(NDC position), exceeds this. That of
    ringlight-basis goes by the run's length: 1e-4 in runs of up to 7,000 steps, 2e-4 from 30,000 steps on."""
    begin: int | None = None
    """Gaussians are added after this step. By default 500 as in 3DGS, or a tenth of the run if that is less."""
    stop: float = 0.5
    """Share of all steps after which no Gaussians are added."""
    latest: int = 15_000
    """No Gaussians are added after this step, however long the run."""
    every: int = 100
    """Steps between two rounds."""
    clone_below: float | None = None
    """Gaussians up to this share of the scene's extent are cloned; wider ones are split. By default 0.01 as in 3DGS in
    a run of its 30,000 steps or more, and 0 in shorter ones: all are split."""
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
    come first. 0 takes as many as a training photograph has pixels, since no view could tell more apart;
    ringlight-basis takes 0.85 of them. Where a subject is cut out, ringlight-mirror takes one for every seven pixels,
    but at least 200 for each photograph, between 10,000 and 20,000, if there are as many pixels. With mcmc it is the
    number at the end, to the Gaussian; 0 is one for every four pixels then, but for subjects of ringlight-mirror."""
    pixel_bound: bool = later(True)
    """Whether max_gaussians of 0 takes the photographs' pixels. Without it 0 is no bound, as in 3DGS: a run ends with
    an error once they need more than half of the machine's memory."""
    drop_share: float | None = 0.0
    """Share of the Gaussians that is dropped once no more are added: those that add least to the training photographs.
    Until then there may be max_gaussians / (1 - drop_share), with mcmc there are. 0 keeps all, as 3DGS does. That of
    ringlight-basis goes by the run's length: 0.7 in runs of up to 7,000 steps, 0.4 from 30,000 steps on."""
    drop_until: float = 0.75
    """Share of all steps until which Gaussians are dropped, in five rounds: each at the beginning of a fifth of what
    lies between the last that are added and this."""
    drop_by: Literal["weights", "effects"] = later("weights")
    """What a Gaussian adds. weights: its blending weights, added up. effects: the squared change of the pictures if it
    were gone; where its neighbours have its colour that is little."""
    drop_hidden: float | None = later(0.0)
    """Share of the Gaussians that goes too, right after the last round: those of which the photographs see least, such
    as what hangs under a surface, for views from where nobody photographed (docs/experiments/hidden.md). That of
    ringlight-basis goes by the run's length: 0 in runs of up to 7,000 steps, 0.01 from 30,000 steps on. Without effect
    with mcmc, which ends with an exact number."""
    mcmc: MCMCSettings = later(USUAL_MCMC)
    """What only mcmc has."""

    def __post_init__(self) -> None:
        for name, least in {"begin": 0, "latest": 0, "every": 1, "reset_every": 0, "max_gaussians": 0}.items():
            if (getattr(self, name) or 0) < least:
                raise RecipeError(f"densify.{name} is {getattr(self, name)}; give at least {least}")
        for name in ("threshold", "clone_below", "prune_scale"):
            if not 0 <= (getattr(self, name) or 0) < math.inf:
                raise RecipeError(f"densify.{name} is {getattr(self, name):g}; give 0 or more, but finite")
        self._check_shares()

    def _check_shares(self) -> None:
        for name in ("drop_share", "drop_hidden", "prune_opacity"):
            if not 0 <= (getattr(self, name) or 0) < 1:
                raise RecipeError(f"densify.{name} is {getattr(self, name):g}; give 0 (keep all) or more, below 1")
        for name in ("drop_until", "stop"):
            if not 0 <= getattr(self, name) <= 1:
                raise RecipeError(f"densify.{name} is {getattr(self, name):g}; give a share of all steps, from 0 to 1")
        if not 0 < self.reset_opacity < 1:
            raise RecipeError(f"densify.reset_opacity is {self.reset_opacity}; an opacity lies between 0 and 1")

    def without_effect(self) -> dict[str, str]:
        """Settings that decide nothing as the others are, "mcmc.noise", and why."""
        dropping = {} if self.drop_share != 0 else dict.fromkeys(OF_DROPPING, "--densify.drop-share is 0")
        if self.kind == "mcmc":
            idle = [*OF_ADAPTIVE, "drop_hidden", *(("mcmc.stop",) if self.drop_share != 0 else ("stop", "latest"))]
            return dropping | dict.fromkeys(idle, "--densify.kind is mcmc")
        resets = {} if self.reset_every else dict.fromkeys(OF_RESETS, "--densify.reset-every is 0")
        idle = [f"mcmc.{name}" for name in vars(self.mcmc)]
        return dropping | resets | dict.fromkeys(idle, "--densify.kind is adaptive")

    def deciding(self) -> "DensifySettings":
        """The same with what decides nothing as usual: two are the same density control if these are equal."""
        idle, usual = self.without_effect(), DensifySettings()
        moves = {name: value for name, value in vars(usual.mcmc).items() if f"mcmc.{name}" in idle}
        rest = {name: value for name, value in vars(usual).items() if name in idle}
        return replace(self, mcmc=replace(self.mcmc, **moves), **rest)

    def at_length(self, steps: int) -> "DensifySettings":
        """The same with what is left to the run's length, ``steps``, decided."""
        begin, mcmc = self.begin, self.mcmc.at_length(steps) if self.kind == "mcmc" else self.mcmc
        if begin is None:
            begin = PAPER_BEGIN if self.in_proportion else self.first_step(steps)
        clone_below = self.cloned_below(steps)
        return replace(self, begin=begin, clone_below=clone_below, mcmc=mcmc, **self.growth(steps)._asdict())

    def cloned_below(self, steps: int) -> float:
        """Share of the scene's extent up to which Gaussians are cloned in a run of so many ``steps``."""
        usual = PAPER_CLONE_BELOW if steps >= PAPER_STEPS else 0.0
        return usual if self.clone_below is None else self.clone_below

    def growth(self, steps: int) -> Growth:
        """What a run of so many ``steps`` adds and drops."""
        suits = growth_at(steps)
        return Growth(
            threshold=suits.threshold if self.threshold is None else self.threshold,
            drop_share=suits.drop_share if self.drop_share is None else self.drop_share,
            drop_hidden=suits.drop_hidden if self.drop_hidden is None else self.drop_hidden,
        )

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

    @property
    def prunes(self) -> bool:
        """Whether faint Gaussians are removed; mcmc moves them."""
        return self.kind == "adaptive"

    def within(self, most: int) -> "DensifySettings":
        """These settings with a bound that is a number, ``most`` where they say none, unless they want none."""
        unbounded = self.kind == "adaptive" and not self.pixel_bound
        return self if self.max_gaussians or unbounded else replace(self, max_gaussians=most)

    def usual_bound(self, pixels: int) -> int:
        """What 0 of max_gaussians means where the largest training photograph has so many ``pixels``."""
        return pixels if self.kind == "adaptive" else math.ceil(pixels / PIXELS_PER_GAUSSIAN)

    def most_growing(self, steps: int) -> int:
        """The bound until Gaussians are dropped, in a run of so many ``steps``; 0 where there is none."""
        if not self.drop_rounds(steps):
            return self.max_gaussians
        return int(self.max_gaussians / (1 - self.growth(steps).drop_share))

    def drop_rounds(self, steps: int) -> frozenset[int]:
        """The steps after which Gaussians are dropped; none in runs too short to have grown what could be spared, nor
        where density control goes on to the end."""
        last, until = self.last_step(steps), int(self.drop_until * steps)
        growths = last // self.every - self.first_step(steps) // self.every
        if not self.growth(steps).drop_share or growths < FEWEST_GROWTHS:
            return frozenset()
        rounds = [last + 1 + index * max(until - last, 0) // DROP_ROUNDS for index in range(DROP_ROUNDS)]
        return frozenset(rounds) if max(rounds) <= steps else frozenset()

    def last_step(self, steps: int) -> int:
        """The last step at which rows may be added."""
        if self.kind == "mcmc" and not self.growth(steps).drop_share:
            return int(self.mcmc.stop * steps)
        return min(self.latest, int(self.stop * steps))
