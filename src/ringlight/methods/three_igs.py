"""3iGS: each Gaussian makes its colour of a base, features of its own and a field of light.

Tang and Cham: 3iGS, Factorised Tensorial Illumination for 3D Gaussian Splatting, ECCV 2024 (arXiv 2408.03753). Written
from the paper. Its schedule is that of 30,000 steps, and comes as much earlier as a run is shorter; the rates of the
geometry are those of ``3dgs`` for the run's length (docs/methods/3igs.md).
"""

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from ringlight.color.illumination_settings import IlluminationSettings
from ringlight.core.later import later
from ringlight.errors import RecipeError
from ringlight.fit.photometric import PhotometricLoss
from ringlight.fit.rates import Adam, GaussianRates, check_rates, shorter_by
from ringlight.fit.strategies.densify_settings import DensifySettings
from ringlight.methods.splat_recipe import SplatRecipe
from ringlight.methods.surface_start import SurfaceStart
from ringlight.methods.three_dgs import COARSE_SHARE
from ringlight.methods.warmup import check_warmup

if TYPE_CHECKING:
    from jaxtyping import Float
    from torch import Tensor

    from ringlight.color.contract import ColorModel
    from ringlight.core.scene import Scene
    from ringlight.fit.train import Training
    from ringlight.methods.assembly import Course
    from ringlight.rasterize.contract import Rasterizer
    from ringlight.shade.contract import Shader

PAPER_RATE, MOST_FASTER = 2.5e-3, 4
"""3iGS's learning rate of base colours, roughness and features, and how many times it short runs take at most: then a
grey's logit moves by 0.01 a step, the pace of the constant coefficient of ``3dgs``."""

FIELD_BETAS = (0.9, 0.99)
"""Of the second Adam, which moves all that Gaussians share."""


def column_rate_at(rate: float | None, steps: int) -> float:
    """``rate``, or what suits a run of so many ``steps``."""
    return PAPER_RATE * min(shorter_by(steps), MOST_FASTER) if rate is None else rate


@dataclass(frozen=True)
class ThreeIGSRecipe(SplatRecipe):
    """3iGS (Tang and Cham 2024): base colours, and a factorised field of light that each Gaussian reflects."""

    steps: int = 30_000
    """Training steps, one photograph each."""
    coarse_steps: int = 700
    """Steps with photographs at a quarter of their size, and as many again at half, as ``3dgs`` has (a tenth of the run
    if that is less); 0 for none, as in 3iGS."""
    warmup: float = 0.1
    """Share of the steps with base colours only, before the light is switched on. 3iGS: 3,000 of 30,000."""
    base_rate: float | None = None
    """Learning rate of the base colours' logits. By default 3iGS's 2.5e-3 in a run of 30,000 steps or more; a run half
    as long takes twice of it, and none more than 0.01."""
    roughness_rate: float | None = None
    """Learning rate of the stored roughness; by default as that of base colours."""
    features_rate: float | None = None
    """Learning rate of the Gaussians' features; by default as that of base colours."""
    field_rate: float = 0.02
    """Learning rate of the illumination field's planes and lines."""
    network_rate: float = 1e-3
    """Learning rate of the matrix that mixes the field's components, and of the network."""
    gradient_share: float = 0.25
    """Share of the Gaussians whose light is differentiated each step, drawn by the size of their gradients; 1 for all,
    as in 3iGS. A quarter is right in expectation and saves a third of a step."""
    start: SurfaceStart = field(default_factory=lambda: SurfaceStart(points=0))
    """Where Gaussians start. 3iGS takes the scene's points."""
    antialiased: bool = False
    """Rasterize with the opacity compensation of Mip-Splatting."""
    visible_only: bool = False
    """Step only the Gaussians that the photograph shows; the others keep value and momentum."""
    average: float = later(0.0)
    """The kept model is the mean of the models after each of the last steps, this share of the run, and none before the
    end of density control; 0 keeps the last model."""
    light: IlluminationSettings = field(default_factory=IlluminationSettings)
    """The illumination field and the network."""
    rates: GaussianRates = field(default_factory=GaussianRates)
    """Learning rates of the geometry."""
    densify: DensifySettings = field(default_factory=DensifySettings)
    """Adaptive density control."""
    loss: PhotometricLoss = field(default_factory=PhotometricLoss)
    """What is compared with the photographs."""

    def __post_init__(self) -> None:
        self.check_shares()
        if self.coarse_steps < 0:
            raise RecipeError(f"coarse_steps is {self.coarse_steps}; give 0 (none) or more")
        check_warmup(self.warmup)
        if not 0 < self.gradient_share <= 1:
            raise RecipeError(f"gradient_share is {self.gradient_share:g}; give more than 0, at most 1")
        check_rates(**{name: value or 0.0 for name, value in vars(self).items() if name.endswith("_rate")})

    def at_length(self) -> "ThreeIGSRecipe":
        """See :meth:`SplatRecipe.at_length`."""
        return replace(
            super().at_length(),
            base_rate=column_rate_at(self.base_rate, self.steps),
            roughness_rate=column_rate_at(self.roughness_rate, self.steps),
            features_rate=column_rate_at(self.features_rate, self.steps),
        )

    def build(self, scene: "Scene", rasterize: "Rasterizer", seed: int) -> "Training":
        return self.build_on(self.start.points_in(scene, seed), scene, rasterize, seed)

    def parts(self, box: "Float[Tensor, '2 3']", seed: int = 0) -> "tuple[ColorModel, Shader]":
        from ringlight.color.illuminated import Illuminated
        from ringlight.shade.passthrough import PassThrough

        return Illuminated(self.light, box, seed, self.gradient_share), PassThrough()

    @property
    def first_lit(self) -> int:
        """The last step with base colours only."""
        return max(int(self.warmup * self.steps), 1)

    def course(self, scene: "Scene") -> "Course":
        from ringlight.methods.assembly import Course

        held = self.rates.at_length(self.steps).held
        tables = Adam(held(self.field_rate), FIELD_BETAS)
        networks = Adam(held(self.network_rate), FIELD_BETAS)
        return Course(
            groups={
                "columns.base": Adam(held(column_rate_at(self.base_rate, self.steps))),
                "columns.roughness": Adam(held(column_rate_at(self.roughness_rate, self.steps))),
                "columns.features": Adam(held(column_rate_at(self.features_rate, self.steps))),
                "color.field.planes": tables,
                "color.field.lines": tables,
                "color.field.mix": networks,
                "color.field.offset": networks,
                "color.network.*": networks,
            },
            unlocks={"color.lit": {self.first_lit: 1}},
            surface_opacity=self.start.opacity,
            coarse_steps=min(self.coarse_steps, self.steps // COARSE_SHARE),
            first_lit=self.first_lit,
        )
