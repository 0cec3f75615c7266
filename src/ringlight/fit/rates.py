"""Learning rates as functions of the progress through training. Torch-free: recipes hold these."""

import math
from dataclasses import dataclass

from ringlight.errors import RecipeError


@dataclass(frozen=True)
class Rate:
    """From ``start`` to ``end``, log-linear over the run (3DGS, section 7.3); constant where they are equal."""

    start: float
    end: float

    def __post_init__(self) -> None:
        if not (0 <= self.start < math.inf and 0 <= self.end < math.inf):
            raise RecipeError(f"a learning rate goes from {self.start:g} to {self.end:g}; give 0 (frozen) or more")

    @staticmethod
    def constant(rate: float) -> "Rate":
        """The same rate all along."""
        return Rate(rate, rate)

    def at(self, progress: float) -> float:
        """The rate at ``progress`` in [0, 1]."""
        if self.start == self.end:
            return self.start
        share = min(max(progress, 0.0), 1.0)
        return float(self.start ** (1 - share) * self.end**share)


def check_rates(**rates: float) -> None:
    """Raises RecipeError for a learning rate that is negative, infinite or not a number, by the setting's name."""
    for name, rate in rates.items():
        if not 0 <= rate < math.inf:
            raise RecipeError(f"{name} is {rate:g}; give 0 (frozen) or more")


@dataclass(frozen=True)
class Adam:
    """How a group of parameters is stepped. The paper has two groups: the Gaussians, and the field."""

    rate: Rate
    betas: tuple[float, float] = (0.9, 0.999)
    epsilon: float = 1e-15
    begins: int = 0
    """Step from which ``rate`` counts its progress."""


@dataclass(frozen=True)
class GaussianRates:
    """Learning rates of the table's geometry (3DGS's defaults)."""

    means: float = 1.6e-4
    """Rate of the centres at the start, in units of the scene's extent."""
    means_end: float = 1.6e-6
    """Rate of the centres at the end, in units of the scene's extent."""
    opacities: float = 0.025
    """Rate of the opacity logits. 3DGS took 0.05 until late 2024; half of it gains 0.1 dB with fewer Gaussians."""
    scales: float = 5e-3
    """Rate of the log scales at the start."""
    scales_end: float = 5e-3
    """Rate of the log scales at the end."""
    rotations: float = 1e-3
    """Rate of the quaternions."""

    def __post_init__(self) -> None:
        check_rates(**{f"rates.{name}": rate for name, rate in vars(self).items()})

    def groups(self, extent: float) -> dict[str, Adam]:
        """Adam groups by parameter name."""
        return {
            "columns.means": Adam(Rate(self.means * extent, self.means_end * extent)),
            "columns.opacity_logits": Adam(Rate.constant(self.opacities)),
            "columns.log_scales": Adam(Rate(self.scales, self.scales_end)),
            "columns.quats": Adam(Rate.constant(self.rotations)),
        }
