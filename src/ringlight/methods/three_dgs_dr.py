"""3DGS-DR: harmonics, and a distant environment that is reflected once per pixel.

Ye, Hou, Zhou: 3D Gaussian Splatting with Deferred Reflection, SIGGRAPH 2024. Written from the paper. Its default
starts on a surface, without the paper's propagation and resets, and with harmonics from the first step; shares of the
paper's 61,000 steps on Shiny-Blender are settings. The rates of geometry and base colours are those of ``3dgs`` for the
run's length (docs/methods/3dgs-dr.md).
"""

from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING

from ringlight.core.later import later
from ringlight.core.words import counted
from ringlight.errors import RecipeError
from ringlight.fit.photometric import PhotometricLoss
from ringlight.fit.rates import Adam, GaussianRates, Rate, check_rates, shorter_by
from ringlight.fit.strategies.densify_settings import PAPER_CLONE_BELOW, DensifySettings
from ringlight.fit.strategies.propagation_settings import PropagationSettings
from ringlight.methods.splat_recipe import SplatRecipe
from ringlight.methods.surface_start import SurfaceStart
from ringlight.methods.three_dgs import COARSE_SHARE, harmonics_rates
from ringlight.methods.warmup import WARMUP, check_warmup, unlit_share

if TYPE_CHECKING:
    from jaxtyping import Float
    from torch import Tensor

    from ringlight.color.contract import ColorModel
    from ringlight.core.scene import Scene
    from ringlight.fit.train import Training
    from ringlight.methods.assembly import Course
    from ringlight.methods.recipe import Recipe
    from ringlight.rasterize.contract import Rasterizer
    from ringlight.shade.contract import Shader

PAPER_REFLECTION_RATE, MOST_REFLECTION_RATE = 6e-3, 0.05
"""3DGS-DR's learning rate of the strengths' logits, and the largest in a short run: at 6e-3 half of a run of 1,500
steps passes before a strength of a thousandth is one that shows."""

OF_PROPAGATION = tuple(f"propagation.{f.name}" for f in fields(PropagationSettings))
"""Settings that decide nothing where no round of it comes."""


def reflection_rate_at(rate: float | None, steps: int) -> float:
    """``rate``, or what suits a run of so many ``steps``."""
    return min(PAPER_REFLECTION_RATE * shorter_by(steps), MOST_REFLECTION_RATE) if rate is None else rate


@dataclass(frozen=True)
class ThreeDGSDRRecipe(SplatRecipe):
    """3DGS with deferred reflection (Ye et al. 2024): harmonics, and a cubemap that each pixel reflects."""

    steps: int = 30_000
    """Training steps, one photograph each. 3DGS-DR takes 61,000 on Shiny-Blender."""
    coarse_steps: int = 700
    """Steps with photographs at a quarter of their size, and as many again at half, as ``3dgs`` has (a tenth of the run
    if that is less); 0 for none, as in 3DGS-DR."""
    warmup: float | None = None
    """Share of the steps with base colours only, before the reflection is switched on. By default 0.05, and in runs of
    more than 3,000 steps that start on the visual hull what makes 150 steps. 3DGS-DR: 3,000 of 61,000."""
    sh_degree: int = 3
    """Degree of the base colours' harmonics, 0 to 3."""
    sh_from: float = 0.0
    """Share of the steps before the harmonics' degree rises for the first time. 3DGS-DR: 10,000 of 61,000. With 0.6
    reflections explain more: 0.3 to 0.7 dB better on mirrors, as much worse on coats of varnish."""
    sh_every: float = 0.016
    """Share of the steps between two degrees. 3DGS-DR: 1,000 of 61,000."""
    sh_rate: float | None = None
    """Learning rate of the constant coefficients; by default that of ``3dgs`` for the run's length."""
    sh_rest_rate: float | None = None
    """Learning rate of the view-dependent coefficients; by default that of ``3dgs`` for the run's length."""
    reflection_rate: float | None = None
    """Learning rate of the strengths' logits. By default 3DGS-DR's 6e-3 in a run of 30,000 steps or more; a run half as
    long takes twice of it, and none more than 0.05."""
    environment_rate: float = 0.05
    """Learning rate of the environment's logits."""
    environment_side: int = 32
    """Texels on a side of the environment's six faces. 3DGS-DR: 128, of which short runs leave many as they were drawn,
    for held-out views to see."""
    first_strength: float = 0.3
    """Share of the reflection in a Gaussian's colour at the start, between 0 and 1. 3DGS-DR: 0.001, for its first
    normals are random; on the visual hull they are nearly right."""
    first_texels: float = 0.1
    """Bound of the environment's logits at the start, 0 or more: nearly grey. 3DGS-DR: 5, nearly black to nearly
    white."""
    start: SurfaceStart = field(default_factory=lambda: SurfaceStart(form="discs"))
    """Where Gaussians start. 3DGS-DR takes the scene's points; discs in the hull's surface have normals to begin with,
    which short runs do not find from random points."""
    antialiased: bool = False
    """Rasterize with the opacity compensation of Mip-Splatting."""
    visible_only: bool = False
    """Step only the Gaussians that the photograph shows; the others keep value and momentum."""
    average: float = later(0.0)
    """The kept model is the mean of the models after each of the last steps, this share of the run, and none before the
    end of density control; 0 keeps the last model."""
    propagation: PropagationSettings = field(default_factory=lambda: PropagationSettings(until=0.0))
    """Normal propagation and colour sabotage: none, since on the visual hull they cost more than they find
    (``--propagation.until 0.5``: 3DGS-DR's)."""
    rates: GaussianRates = field(default_factory=GaussianRates)
    """Learning rates of the geometry."""
    densify: DensifySettings = field(
        default_factory=lambda: DensifySettings(clone_below=PAPER_CLONE_BELOW, reset_every=0)
    )
    """Adaptive density control, without opacity resets, which would tear a surface open that is there from the first
    step. 3DGS-DR resets every 3,000 steps. Small Gaussians are cloned in short runs too: on chrome splitting all costs
    0.4 to 0.6 dB after 3,000 steps (docs/experiments/growing-and-dropping.md)."""
    loss: PhotometricLoss = field(default_factory=PhotometricLoss)
    """What is compared with the photographs."""

    def __post_init__(self) -> None:
        self.check_shares()
        if self.coarse_steps < 0:
            raise RecipeError(f"coarse_steps is {self.coarse_steps}; give 0 (none) or more")
        check_warmup(self.warmup)
        for name in ("sh_from", "sh_every"):
            if not 0 <= getattr(self, name) <= 1:
                raise RecipeError(f"{name} is {getattr(self, name):g}; give a share of the steps, from 0 to 1")
        if not 0 < self.first_strength < 1:
            raise RecipeError(f"first_strength is {self.first_strength:g}; give a share between 0 and 1")
        if not 0 <= self.first_texels < float("inf"):
            raise RecipeError(f"first_texels is {self.first_texels:g}; give 0 or more")
        check_rates(**{name: value or 0.0 for name, value in vars(self).items() if name.endswith("_rate")})

    def settled(self, scene: "Scene", rasterize: "Rasterizer", seed: int) -> "tuple[ThreeDGSDRRecipe, None]":
        """See :meth:`SplatRecipe.settled`; and how long the warm-up is, which normals of a hull do not need."""
        settled, _ = super().settled(scene, rasterize, seed)
        if self.warmup is None and not self.start.has_normals_of(scene):
            settled = replace(settled, warmup=WARMUP)
        return settled, None

    def may_settle_on(self, other: "Recipe") -> bool:
        """See :meth:`SplatRecipe.may_settle_on`; with the warm-up of either start."""
        if self.warmup is None and isinstance(other, ThreeDGSDRRecipe) and other.warmup == WARMUP:
            other = replace(other, warmup=unlit_share(None, self.steps))
        return super().may_settle_on(other)

    def at_length(self) -> "ThreeDGSDRRecipe":
        """See :meth:`SplatRecipe.at_length`."""
        of_dc, of_rest = harmonics_rates(self.sh_rate, self.sh_rest_rate, self.steps)
        of_strengths = reflection_rate_at(self.reflection_rate, self.steps)
        settled = replace(super().at_length(), sh_rate=of_dc, sh_rest_rate=of_rest)
        return replace(settled, reflection_rate=of_strengths, warmup=unlit_share(self.warmup, self.steps))

    def build(self, scene: "Scene", rasterize: "Rasterizer", seed: int) -> "Training":
        return self.build_on(self.start.with_normals_in(scene, seed), scene, rasterize, seed)

    def parts(self, box: "Float[Tensor, '2 3']", seed: int = 0) -> "tuple[ColorModel, Shader]":
        from ringlight.color.reflective_harmonics import ReflectiveHarmonics
        from ringlight.shade.environment import EnvironmentShader

        environment = EnvironmentShader(self.environment_side, seed, self.first_texels)
        return ReflectiveHarmonics(self.sh_degree, self.first_strength), environment

    @property
    def first_lit(self) -> int:
        """The last step with base colours only."""
        return max(int(unlit_share(self.warmup, self.steps) * self.steps), 1)

    @property
    def degrees(self) -> dict[int, int]:
        """The harmonics' degree by the step after which it is taken."""
        first, every = int(self.sh_from * self.steps), max(int(self.sh_every * self.steps), 1)
        return {max(first, 1) + (degree - 1) * every: degree for degree in range(1, self.sh_degree + 1)}

    def without_effect(self) -> dict[str, str]:
        """See :meth:`SplatRecipe.without_effect`: also what a round of propagation does, where there is none."""
        if self.propagation.rounds(self.first_lit, self.steps):
            return super().without_effect()
        apart, until = self.propagation.paced(self.steps), self.propagation.until
        reason = f"no round comes until {until:g} of the run, {counted(apart, 'step')} after the reflection is on"
        return super().without_effect() | dict.fromkeys(OF_PROPAGATION, reason)

    def course(self, scene: "Scene") -> "Course":
        from ringlight.fit.strategies.propagate_normals import PropagateNormals
        from ringlight.methods.assembly import Course

        recipe = self.at_length()
        of_dc, of_rest = harmonics_rates(recipe.sh_rate, recipe.sh_rest_rate, self.steps)
        held, first_lit = recipe.rates.held, self.first_lit
        rounds = self.propagation.rounds(first_lit, self.steps)
        return Course(
            groups={
                "columns.opacity_logits": Adam(
                    held(recipe.rates.opacities), frozen=self.propagation.held(rounds, self.steps)
                ),
                "columns.sh_dc": Adam(held(of_dc)),
                "columns.sh_rest": Adam(held(of_rest)),
                "columns.reflection_logits": Adam(Rate.constant(reflection_rate_at(self.reflection_rate, self.steps))),
                "shader.texels": Adam(Rate.constant(self.environment_rate)),
            },
            unlocks={"color.harmonic.active_degree": self.degrees, "shader.lit": {first_lit: 1}},
            surface_opacity=self.start.opacity,
            coarse_steps=min(self.coarse_steps, self.steps // COARSE_SHARE),
            last=lambda control, seed: (PropagateNormals(self.propagation, rounds, control.resets, seed),),
        )
