"""Learning rates as functions of the progress through training. Torch-free: recipes hold these."""

import math
from dataclasses import dataclass, replace

from ringlight.errors import RecipeError


@dataclass(frozen=True)
class Rate:
    """From ``start`` to ``end``, log-linear over the run (3DGS, section 7.3); constant where they are equal, and where
    it starts at 0, which is frozen.

    It falls from the share ``hold`` of the run on; until then it keeps its start. Raises RecipeError for rates that are
    negative or not finite, and for a fall to 0, which has no logarithm.
    """

    start: float
    end: float
    hold: float = 0.0

    def __post_init__(self) -> None:
        if not (0 <= self.start < math.inf and 0 <= self.end < math.inf):
            raise RecipeError(f"a learning rate goes from {self.start:g} to {self.end:g}; give 0 (frozen) or more")
        if self.end == 0 < self.start:
            raise RecipeError(f"a learning rate falls from {self.start:g} to 0, at once; give an end above 0")
        if not 0 <= self.hold < 1:
            raise RecipeError(f"a learning rate is held for {self.hold:g} of the run; give 0 to below 1")

    @staticmethod
    def constant(rate: float) -> "Rate":
        """The same rate all along."""
        return Rate(rate, rate)

    def at(self, progress: float) -> float:
        """The rate at ``progress`` in [0, 1]."""
        if self.start in (0.0, self.end):
            return self.start
        share = min(max((progress - self.hold) / (1 - self.hold), 0.0), 1.0)
        return float(self.start ** (1 - share) * self.end**share)


@dataclass(frozen=True)
class Part:
    """A rate until the share ``end`` of the run; it is what ``rate`` is from its progress ``first`` to its end."""

    end: float
    rate: Rate
    first: float = 0.0


@dataclass(frozen=True)
class RateInParts:
    """One rate after another, each from where the one before it ends; the last part ends with the run."""

    parts: tuple[Part, ...]

    def at(self, progress: float) -> float:
        """The rate at ``progress`` in [0, 1]."""
        begin = 0.0
        for part in self.parts[:-1]:
            if progress <= part.end:
                return part.rate.at(self._within(part, begin, progress))
            begin = part.end
        return self.parts[-1].rate.at(self._within(self.parts[-1], begin, progress))

    @staticmethod
    def _within(part: Part, begin: float, progress: float) -> float:
        length = part.end - begin
        return part.first + (1 - part.first) * ((progress - begin) / length if length > 0 else 1.0)


def check_rates(**rates: float) -> None:
    """Raises RecipeError for a learning rate that is negative, infinite or not a number, by the setting's name."""
    for name, rate in rates.items():
        if not 0 <= rate < math.inf:
            raise RecipeError(f"{name} is {rate:g}; give 0 (frozen) or more")


def check_fall(name: str, start: float, end: float) -> None:
    """Raises RecipeError, by the name of the end, for a rate that falls to 0. Asked where something is trained: models
    of before can be shown."""
    if end == 0 < start:
        raise RecipeError(f"{name} is 0, where a rate that falls by factors is at once; give a small number above 0")


@dataclass(frozen=True)
class Adam:
    """How a group of parameters is stepped. The paper has two groups: the Gaussians, and the field."""

    rate: Rate | RateInParts
    betas: tuple[float, float] = (0.9, 0.999)
    epsilon: float = 1e-15
    begins: int = 0
    """Step from which ``rate`` counts its progress."""
    frozen: tuple[tuple[int, int], ...] = ()
    """First and last step of spans in which the rate is zero; moments go on."""
    decay: float = 0.0
    """Share of the rate by which all numbers of a parameter shrink before each step that it takes (Loshchilov and
    Hutter 2019, "Decoupled weight decay regularization"). Not of a table's columns."""

    def moves(self, step: int) -> bool:
        """Whether ``step`` lies in none of the frozen spans."""
        return not any(first <= step <= last for first, last in self.frozen)


PAPER_STEPS = 30_000
"""Length of a run of 3DGS, which its rates are made for."""

PAPER_MEANS, PAPER_SCALES = 1.6e-4, 5e-3
"""3DGS's rates at the start: of the centres, in units of the scene's extent, and of the log scales."""

PAPER_OPACITIES = 0.05
"""3DGS's rate of the opacity logits as published, and in its program until late 2024."""

FAST_MEANS = 3.2e-4
"""Twice 3DGS's rate of the centres: worth up to 0.5 dB after 3,000 steps (docs/experiments/baseline.md)."""

FAST_SCALES = 2e-2
"""Learning rate of the log scales at the start: four times that of 3DGS, at which they end. What is far too large or
small for its place is so for less of a run."""


SHORT_HOLD, HELD_END = 0.75, 0.1
"""In short runs rates are held for this share of the steps, and fall to this share of their start: what was learned at
high rates settles. Worth 0.1 dB after 3,000 steps (docs/experiments/baseline.md)."""


SHORT_STEPS = 7_000
"""What differs between short and long runs, was found at up to so many steps and at 3DGS's 30,000."""


def how_long(steps: int, short: int = SHORT_STEPS) -> float:
    """0 for runs of up to ``short`` steps, 1 from PAPER_STEPS on, and in between even in the logarithm of ``steps``."""
    share = math.log(max(steps, 1) / short) / math.log(PAPER_STEPS / short)
    return min(max(share, 0.0), 1.0)


def between(short: float, long: float, share: float) -> float:
    """``short`` at 0, ``long`` at 1, even in the logarithm; exactly these at the ends."""
    return short ** (1 - share) * long**share


def shorter_by(steps: int) -> float:
    """How many times as long as this run one of 3DGS is; at least one."""
    return max(PAPER_STEPS / max(steps, 1), 1.0)


@dataclass(frozen=True)
class GaussianRates:
    """Learning rates of the table's geometry; those of 3DGS, or what suits the length of a shorter run."""

    means: float | None = None
    """Rate of the centres at the start, in units of the scene's extent. By default 3DGS's 1.6e-4 in a run of its 30,000
    steps or more; a run half as long begins twice as fast, and so do shorter ones."""
    means_end: float = 1.6e-6
    """Rate of the centres at the end, in units of the scene's extent."""
    opacities: float = 0.025
    """Rate of the opacity logits, as 3DGS's program has it since late 2024. Before it had 0.05, as its paper; half of
    it gains 0.1 dB with fewer Gaussians."""
    scales: float | None = None
    """Rate of the log scales at the start. By default 3DGS's 5e-3 in a run of its 30,000 steps or more; a run half as
    long begins twice as fast, and none faster than 2e-2."""
    scales_end: float = 5e-3
    """Rate of the log scales at the end."""
    rotations: float = 1e-3
    """Rate of the quaternions."""
    hold: float | None = None
    """Share of the run in which the rates of opacities and rotations are kept, and those of the colours of 3dgs and
    ringlight-basis; then they fall to a tenth. 1: they never fall, as in 3DGS. By default 1 in a run of its 30,000
    steps or more, 0.75 in shorter ones."""

    def __post_init__(self) -> None:
        if self.hold is not None and not 0 <= self.hold <= 1:
            raise RecipeError(f"rates.hold is {self.hold:g}; give a share of the run, from 0 to 1")
        check_rates(**{f"rates.{name}": rate for name, rate in vars(self).items() if rate is not None})

    def held(self, rate: float) -> Rate:
        """``rate``, and its fall at the end of the run. Raises RecipeError where that is left to the run's length."""
        if self.hold is None:
            raise RecipeError("rates.hold is left to the run's length; ask at_length first")
        return Rate.constant(rate) if self.hold == 1 else Rate(rate, HELD_END * rate, self.hold)

    def at_length(self, steps: int) -> "GaussianRates":
        """The same with what is left to the run's length, ``steps``, decided."""
        faster = shorter_by(steps)
        means = min(PAPER_MEANS * faster, FAST_MEANS) if self.means is None else self.means
        scales = min(PAPER_SCALES * faster, FAST_SCALES) if self.scales is None else self.scales
        hold = (1.0 if steps >= PAPER_STEPS else SHORT_HOLD) if self.hold is None else self.hold
        return replace(self, means=means, scales=scales, hold=hold)

    def groups(self, extent: float) -> dict[str, Adam]:
        """Adam groups by parameter name, for a scene of this extent in world units. Raises RecipeError where rates are
        still left to the run's length, or fall to 0."""
        if self.means is None or self.scales is None:
            raise RecipeError("rates.means or rates.scales is left to the run's length; ask at_length first")
        check_fall("rates.means_end", self.means, self.means_end)
        check_fall("rates.scales_end", self.scales, self.scales_end)
        return {
            "columns.means": Adam(Rate(self.means * extent, self.means_end * extent)),
            "columns.opacity_logits": Adam(self.held(self.opacities)),
            "columns.log_scales": Adam(Rate(self.scales, self.scales_end)),
            "columns.quats": Adam(self.held(self.rotations)),
        }
