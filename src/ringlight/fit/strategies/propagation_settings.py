"""Settings of normal propagation, and when its rounds come. Torch-free: recipes hold these."""

import math
from dataclasses import dataclass

from ringlight.errors import RecipeError

PAPER_STEPS = 61_000
"""Length of a run of 3DGS-DR on Shiny-Blender, which its schedule is stated for."""


@dataclass(frozen=True)
class PropagationSettings:
    """Normal propagation (3DGS-DR, section 4.3): rounds after which good normals spread to their neighbours."""

    until: float = 0.5
    """Share of the run in which the last round comes. 3DGS-DR: 24,000 of 61,000 steps, 48,000 of 85,000 for the
    toaster."""
    every: int = 1000
    """Steps between two rounds in a run of 61,000; in others they are in proportion, but for ``least``."""
    least: int = 1000
    """Fewest steps between two rounds, however short the run: what a round disturbs must settle."""
    opacity: float = 0.9
    """Opacities below this are raised to it."""
    hold: float = 0.2
    """Share of the steps between two rounds in which opacities then stay as they are."""
    reflective: float = 0.02
    """Gaussians that reflect more than this are enlarged."""
    enlarge: float = 1.5
    """Factor of their axes, but for the shortest."""
    dull: float = 0.05
    """Gaussians that reflect less than this get noise on their base colour, so that colour alone cannot explain what a
    mirror shows."""
    sabotage: float = 0.4
    """Bound of that noise, on the constant coefficient of the harmonics."""

    def __post_init__(self) -> None:
        for name in ("until", "hold", "reflective", "dull"):
            if not 0 <= getattr(self, name) <= 1:
                raise RecipeError(f"propagation.{name} is {getattr(self, name):g}; give a share, from 0 to 1")
        for name in ("every", "least"):
            if getattr(self, name) < 1:
                raise RecipeError(f"propagation.{name} is {getattr(self, name)}; give at least 1 step")
        if not 0 < self.opacity < 1:
            raise RecipeError(f"propagation.opacity is {self.opacity:g}; an opacity lies between 0 and 1")
        if not 1 <= self.enlarge < math.inf:
            raise RecipeError(f"propagation.enlarge is {self.enlarge:g}; give 1 (nothing is enlarged) or more, finite")
        if not 0 <= self.sabotage < math.inf:
            raise RecipeError(f"propagation.sabotage is {self.sabotage:g}; give 0 (no noise) or more, but finite")

    def paced(self, steps: int) -> int:
        """Steps between two rounds in a run of so many ``steps``."""
        return max(round(self.every * steps / PAPER_STEPS), self.least)

    def rounds(self, first_lit: int, steps: int) -> tuple[int, ...]:
        """The steps after which a round comes, once the reflection was on for one distance between rounds."""
        every = self.paced(steps)
        return tuple(range(first_lit + every, int(self.until * steps) + 1, every))

    def held(self, rounds: tuple[int, ...], steps: int) -> tuple[tuple[int, int], ...]:
        """First and last step of the spans, one a round, in which opacities stay as they are."""
        length = round(self.hold * self.paced(steps))
        return tuple((step + 1, step + length) for step in rounds) if length else ()
