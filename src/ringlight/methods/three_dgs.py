"""3D Gaussian Splatting: the yardstick.

Kerbl, Kopanas, Leimkühler, Drettakis: 3D Gaussian Splatting for Real-Time Radiance Field Rendering, SIGGRAPH 2023.
Written from the paper; the rasterizer's numbers are gsplat's (see rasterize/convention.py). The default takes the
paper's rates in a run of its 30,000 steps, and in shorter ones rates that suit their length
(docs/experiments/baseline.md). PAPER takes the paper's at any length.
"""

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from ringlight.core.later import later
from ringlight.errors import RecipeError
from ringlight.fit.photometric import PhotometricLoss
from ringlight.fit.rates import (
    PAPER_MEANS,
    PAPER_OPACITIES,
    PAPER_SCALES,
    Adam,
    GaussianRates,
    check_rates,
    shorter_by,
)
from ringlight.fit.strategies.densify_settings import PAPER_BEGIN, PAPER_CLONE_BELOW, DensifySettings
from ringlight.methods.splat_recipe import SplatRecipe
from ringlight.methods.surface_start import SurfaceStart

if TYPE_CHECKING:
    from jaxtyping import Float
    from torch import Tensor

    from ringlight.color.contract import ColorModel
    from ringlight.core.scene import Scene
    from ringlight.fit.train import Training
    from ringlight.methods.assembly import Course
    from ringlight.rasterize.contract import Rasterizer
    from ringlight.shade.contract import Shader

DEGREE_SHARE = 7
"""In short runs the SH degree rises every seventh of the run, so that degree 3 has most of it to learn."""

PAPER_DC_RATE, PAPER_REST_RATE = 2.5e-3, 1.25e-4
"""3DGS's learning rates of the constant and of the view-dependent coefficients."""

MOST_DC, MOST_REST = 2, 20
"""Times these are they at most, however short the run (docs/experiments/baseline.md)."""


def harmonics_rates(of_dc: float | None, of_rest: float | None, steps: int) -> tuple[float, float]:
    """Both rates, with what is left to the run's length, ``steps``, decided."""
    faster = shorter_by(steps)
    constant = PAPER_DC_RATE * min(faster, MOST_DC) if of_dc is None else of_dc
    return constant, PAPER_REST_RATE * min(faster, MOST_REST) if of_rest is None else of_rest


HIGHEST_DEGREE = 3
"""What 3DGS stores for each Gaussian, what shared functions have, and what viewers know."""


def degrees_by_step(sh_every: int, steps: int, highest: int = HIGHEST_DEGREE) -> dict[int, int]:
    """The degrees of harmonics up to the ``highest`` by the step that switches them on, in a run of so many steps."""
    every = max(min(sh_every, steps // DEGREE_SHARE), 1)
    return {degree * every: degree for degree in range(1, highest + 1)}


COARSE_SHARE = 10
"""Smaller photographs take no more of a short run than a tenth at each size: 1,000 steps of which all 1,000 saw
them reached 20.38 dB and SSIM 0.854 on a toaster at 400 pixels, with 71 at each size 20.57 dB and 0.865."""


@dataclass(frozen=True)
class ThreeDGSRecipe(SplatRecipe):
    """3D Gaussian Splatting (Kerbl et al. 2023): colour as spherical harmonics of each Gaussian."""

    steps: int = 30_000
    """Training steps, one photograph each."""
    coarse_steps: int = 700
    """Steps with photographs at a quarter of their size, and as many again at half (a tenth of the run if
    that is less); 0 for none. 3DGS (section 7.1) takes 250."""
    sh_degree: int = 3
    """Degree of the spherical harmonics, 0 to 3."""
    sh_every: int = 1000
    """Steps after which one more degree is switched on (a seventh of the run if that is less)."""
    sh_rate: float | None = None
    """Learning rate of the constant coefficients. By default 3DGS's 2.5e-3 in a run of its 30,000 steps or more; a run
    half as long takes twice of it, and so do shorter ones."""
    sh_rest_rate: float | None = None
    """Learning rate of the view-dependent coefficients. By default 3DGS's 1.25e-4 in a run of its 30,000 steps or more;
    a run half as long takes twice of it, and none more than 2.5e-3."""
    start: SurfaceStart = field(default_factory=lambda: SurfaceStart(points=0))
    """Where Gaussians start. 3DGS takes the scene's points."""
    antialiased: bool = False
    """Rasterize with the opacity compensation of Mip-Splatting."""
    visible_only: bool = False
    """Step only the Gaussians that the photograph shows; the others keep value and momentum (faster, not the paper)."""
    average: float = later(0.0)
    """The kept model is the mean of the models after each of the last steps, this share of the run, and none before the
    end of density control; 0 keeps the last model."""
    dropout: float = later(0.0)
    """Share of the Gaussians that a training picture goes without, drawn anew for each in the second half of the run,
    once density control adds none; 0 for none."""
    rates: GaussianRates = field(default_factory=GaussianRates)
    """Learning rates of the geometry."""
    densify: DensifySettings = field(default_factory=DensifySettings)
    """Adaptive density control."""
    loss: PhotometricLoss = field(default_factory=PhotometricLoss)
    """What is compared with the photographs."""

    def __post_init__(self) -> None:
        if self.coarse_steps < 0:
            raise RecipeError(f"coarse_steps is {self.coarse_steps}; give 0 (none) or more")
        self.check_shares()
        check_rates(sh_rate=self.sh_rate or 0.0, sh_rest_rate=self.sh_rest_rate or 0.0)

    def at_length(self) -> "ThreeDGSRecipe":
        """See :meth:`SplatRecipe.at_length`."""
        of_dc, of_rest = harmonics_rates(self.sh_rate, self.sh_rest_rate, self.steps)
        return replace(super().at_length(), sh_rate=of_dc, sh_rest_rate=of_rest)

    def build(self, scene: "Scene", rasterize: "Rasterizer", seed: int) -> "Training":
        return self.build_on(self.start.points_in(scene, seed), scene, rasterize, seed)

    def parts(self, box: "Float[Tensor, '2 3']", seed: int = 0) -> "tuple[ColorModel, Shader]":
        from ringlight.color.harmonics import SphericalHarmonics
        from ringlight.shade.passthrough import PassThrough

        return SphericalHarmonics(self.sh_degree), PassThrough()

    def course(self, scene: "Scene") -> "Course":
        from ringlight.methods.assembly import Course

        of_dc, of_rest = harmonics_rates(self.sh_rate, self.sh_rest_rate, self.steps)
        held = self.rates.at_length(self.steps).held
        return Course(
            groups={
                "columns.sh_dc": Adam(held(of_dc)),
                "columns.sh_rest": Adam(held(of_rest)),
            },
            unlocks={"color.active_degree": degrees_by_step(self.sh_every, self.steps, self.sh_degree)},
            surface_opacity=self.start.opacity,
            coarse_steps=min(self.coarse_steps, self.steps // COARSE_SHARE),
        )


PAPER = ThreeDGSRecipe(
    coarse_steps=250,
    sh_rate=PAPER_DC_RATE,
    sh_rest_rate=PAPER_REST_RATE,
    rates=GaussianRates(means=PAPER_MEANS, opacities=PAPER_OPACITIES, scales=PAPER_SCALES, hold=1.0),
    densify=DensifySettings(begin=PAPER_BEGIN, clone_below=PAPER_CLONE_BELOW),
)
"""The paper's rates and coarse photographs at any length: made for 30,000 steps, and starved in shorter runs. The
harmonics' degree rises faster in short runs, as in the default."""
