"""Settings of adaptive density control. Torch-free: recipes hold these."""

from dataclasses import dataclass, replace

from ringlight.errors import RecipeError


@dataclass(frozen=True)
class DensifySettings:
    """Adaptive density control (3DGS, section 5.2)."""

    threshold: float = 2e-4
    """A Gaussian is cloned or split when its mean screen-space pull, dL/d(NDC position), exceeds this."""
    begin: int = 500
    """First step after which Gaussians are added."""
    stop: float = 0.5
    """Share of all steps after which the number of Gaussians stays."""
    latest: int = 15_000
    """No densification after this step, however long the run."""
    every: int = 100
    """Steps between two rounds."""
    clone_below: float = 0.01
    """Gaussians up to this share of the scene's extent are cloned, larger ones split."""
    prune_opacity: float = 0.005
    """Fainter Gaussians are removed."""
    prune_scale: float = 0.1
    """After the first opacity reset, Gaussians wider than this share of the scene's extent are removed."""
    reset_every: int = 3000
    """Steps between two opacity resets; 0 never resets."""
    reset_opacity: float = 0.01
    """Opacities are lowered to this at a reset."""
    max_gaussians: int = 0
    """Never more than this many; the strongest pulls are served first. 0: as many as a training photograph has pixels,
    since no view could tell more apart."""

    def __post_init__(self) -> None:
        for name, least in {"begin": 0, "latest": 0, "every": 1, "reset_every": 0, "max_gaussians": 0}.items():
            if getattr(self, name) < least:
                raise RecipeError(f"densify.{name} is {getattr(self, name)}; give at least {least}")
        for name in ("threshold", "clone_below", "prune_scale"):
            if not getattr(self, name) >= 0:
                raise RecipeError(f"densify.{name} is {getattr(self, name):g}; give 0 or more")
        if not 0 <= self.stop <= 1:
            raise RecipeError(f"densify.stop is {self.stop:g}; give a share of all steps, from 0 to 1")
        if not 0 < self.reset_opacity < 1:
            raise RecipeError(f"densify.reset_opacity is {self.reset_opacity}; an opacity lies between 0 and 1")
        if not 0 <= self.prune_opacity < 1:
            raise RecipeError(f"densify.prune_opacity is {self.prune_opacity}; give 0 (keep all) or more, below 1")

    def within(self, pixels: int) -> "DensifySettings":
        """These settings with a bound that is a number; ``pixels`` are those of the largest training photograph."""
        return self if self.max_gaussians else replace(self, max_gaussians=pixels)

    def last_step(self, steps: int) -> int:
        """The last step at which rows may be added."""
        return min(self.latest, int(self.stop * steps))
