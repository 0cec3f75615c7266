"""gaussian-shader: Gaussians that are shaded one by one under a learned environment.

Jiang, Tu, Liu, Gao, Long, Wang, Ma: GaussianShader: 3D Gaussian Splatting with Shading Functions for Reflective
Surfaces, CVPR 2024. Written from the paper. What differs: docs/methods/gaussian-shader.md.
"""

import sys
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from ringlight.core.later import later
from ringlight.errors import RecipeError
from ringlight.fit.photometric import PhotometricLoss
from ringlight.fit.rates import Adam, GaussianRates, Rate, between, check_rates, how_long
from ringlight.fit.strategies.densify_settings import DensifySettings
from ringlight.methods.splat_recipe import SplatRecipe
from ringlight.methods.surface_start import SurfaceStart
from ringlight.methods.three_dgs import COARSE_SHARE, degrees_by_step, harmonics_rates

if TYPE_CHECKING:
    from jaxtyping import Float
    from torch import Tensor

    from ringlight.color.contract import ColorModel
    from ringlight.core.scene import Scene
    from ringlight.fit.regularizers.contract import Regularizer
    from ringlight.fit.train import Training
    from ringlight.methods.assembly import Course
    from ringlight.rasterize.contract import Rasterizer
    from ringlight.shade.contract import Shader

PAPER_RATE = 1.6e-2
"""GaussianShader's rate of materials, normals and environment at the start."""

SHORT_ENVIRONMENT, SHORT_MATERIAL, SHORT_NORMAL = 0.05, 0.1, 1e-3
"""Rates of short runs: with the paper's, roughnesses hardly move in a thousand steps, and residuals make normals
noisy (docs/methods/gaussian-shader.md)."""

RATE_FALL = 0.1
"""GaussianShader's rates of materials, normals and environment fall from 1.6e-2 to 1.6e-3 over a run."""

OF_CONSISTENCY = ("consistency_stride", "consistency_every")
"""Settings that decide nothing where normals need not agree with depths."""


@dataclass(frozen=True)
class GaussianShaderRecipe(SplatRecipe):
    """GaussianShader (Jiang et al. 2024): each Gaussian reflects a learned environment, as rough as it is."""

    steps: int = 30_000
    """Training steps, one photograph each."""
    coarse_steps: int = 700
    """Steps with photographs at a quarter of their size, and as many again at half, as ``3dgs`` has (a tenth of the run
    if that is less); 0 for none, as in GaussianShader."""
    sh_degree: int = 3
    """Degree of the residual colour's harmonics, 0 to 3; 0 for none. GaussianShader's paper has them, its published
    settings for Shiny-Blender have none."""
    sh_every: int = 1000
    """Steps after which one more degree is switched on (a seventh of the run if that is less)."""
    sh_rate: float | None = None
    """Learning rate of the diffuse colours; by default that of the constant harmonics of ``3dgs`` for the run's
    length."""
    sh_rest_rate: float | None = None
    """Learning rate of the residual colours; by default that of ``3dgs`` for the run's length."""
    ambient: bool = False
    """Add diffuse light of the environment by the normal, (1 - tint) times. GaussianShader's paper does not."""
    first_tint: float = 0.5
    """Reflectance at normal incidence with which Gaussians start."""
    environment_side: int = 64
    """Texels on a side of the environment's six faces, 16 times a power of two."""
    environment_rate: float | None = None
    """Learning rate of the environment's logits at the start; it falls to a tenth. By default 0.05 in runs of up to
    7,000 steps and GaussianShader's 1.6e-2 from 30,000 steps on."""
    material_rate: float | None = None
    """Learning rate of tints and roughnesses at the start; it falls to a tenth. By default 0.1 and 1.6e-2 likewise."""
    normal_rate: float | None = None
    """Learning rate of the normals' residuals at the start; it falls to a tenth. By default 1e-3 and 1.6e-2
    likewise."""
    consistency: float = 0.02
    """Weight of 1 - cosine between blended normals and those of the blended depths; 0 for none. GaussianShader has 0.2,
    which costs 0.4 dB and more in short runs (docs/methods/gaussian-shader.md)."""
    consistency_stride: int = 4
    """Every so many rows and columns of pixels it is asked for, others each time; GaussianShader asks for all."""
    consistency_every: int = later(1, now=4)
    """It is asked for every so many steps, and counts as many times; GaussianShader asks each step, which learns no
    better (docs/methods/gaussian-shader.md)."""
    zero_one: float = 1e-3
    """Weight of the entropy of alpha; 0 for none."""
    residual_penalty: float = 1e-3
    """Weight of the mean squared length of the normals' residuals; 0 for none."""
    start: SurfaceStart = field(default_factory=lambda: SurfaceStart(form="discs"))
    """Where Gaussians start. GaussianShader takes the scene's points; discs in the hull's surface have normals to begin
    with, which short runs do not find from random points."""
    antialiased: bool = False
    """Rasterize with the opacity compensation of Mip-Splatting."""
    visible_only: bool = False
    """Step only the Gaussians that the photograph shows; the others keep value and momentum."""
    average: float = later(0.0)
    """The kept model is the mean of the models after each of the last steps, this share of the run, and none before the
    end of density control; 0 keeps the last model."""
    rates: GaussianRates = field(default_factory=GaussianRates)
    """Learning rates of the geometry."""
    densify: DensifySettings = field(default_factory=lambda: DensifySettings(reset_every=0))
    """Adaptive density control, without opacity resets, which would tear a surface open that is there from the first
    step. GaussianShader resets every 3,000 steps."""
    loss: PhotometricLoss = field(default_factory=PhotometricLoss)
    """What is compared with the photographs."""

    def __post_init__(self) -> None:
        self.check_shares()
        if self.coarse_steps < 0:
            raise RecipeError(f"coarse_steps is {self.coarse_steps}; give 0 (none) or more")
        if not 0 < self.first_tint < 1:
            raise RecipeError(f"first_tint is {self.first_tint:g}; a reflectance lies between 0 and 1")
        if self.consistency_stride < 1:
            raise RecipeError(f"consistency_stride is {self.consistency_stride}; give 1 (every pixel) or more")
        if self.consistency_every < 1:
            raise RecipeError(f"consistency_every is {self.consistency_every}; give 1 (each step) or more")
        for name in ("consistency", "zero_one", "residual_penalty"):
            if not 0 <= getattr(self, name) < float("inf"):
                raise RecipeError(f"{name} is {getattr(self, name):g}; give a weight of 0 (none) or more")
        check_rates(**{name: value or 0.0 for name, value in vars(self).items() if name.endswith("_rate")})

    def at_length(self) -> "GaussianShaderRecipe":
        """See :meth:`SplatRecipe.at_length`."""
        of_dc, of_rest = harmonics_rates(self.sh_rate, self.sh_rest_rate, self.steps)
        of_light = self.light_rates
        return replace(
            super().at_length(),
            sh_rate=of_dc,
            sh_rest_rate=of_rest,
            environment_rate=of_light["environment_rate"],
            material_rate=of_light["material_rate"],
            normal_rate=of_light["normal_rate"],
        )

    @property
    def light_rates(self) -> dict[str, float]:
        """By setting, those of environment, materials and normals at the start, as set or as suits the run's length."""
        stated = {
            "environment_rate": (self.environment_rate, SHORT_ENVIRONMENT),
            "material_rate": (self.material_rate, SHORT_MATERIAL),
            "normal_rate": (self.normal_rate, SHORT_NORMAL),
        }
        long = how_long(self.steps)
        return {name: between(short, PAPER_RATE, long) if own is None else own for name, (own, short) in stated.items()}

    def build(self, scene: "Scene", rasterize: "Rasterizer", seed: int) -> "Training":
        return self.build_on(self.start.with_normals_in(scene, seed), scene, rasterize, seed)

    def parts(self, box: "Float[Tensor, '2 3']", seed: int = 0) -> "tuple[ColorModel, Shader]":
        from ringlight.color.shaded_gaussians import ShadedGaussians
        from ringlight.color.split_sum import SplitSumLight
        from ringlight.shade.passthrough import PassThrough

        light = SplitSumLight(self.environment_side)
        return ShadedGaussians(light, self.sh_degree, self.ambient, self.first_tint), PassThrough()

    def without_effect(self) -> dict[str, str]:
        """See :meth:`SplatRecipe.without_effect`: also how often normals are asked to agree, where they need not."""
        idle = {} if self.consistency else dict.fromkeys(OF_CONSISTENCY, "--consistency is 0")
        return super().without_effect() | idle

    def regularizers(self) -> "dict[str, Regularizer]":
        """Those with a weight, by name; weights are relative to the loss of photographs."""
        from ringlight.fit.regularizers.depth_normals import DepthNormals
        from ringlight.fit.regularizers.small_columns import SmallColumn
        from ringlight.fit.regularizers.zero_one import ZeroOne

        # Without an end, for steps may be added to a run.
        scale, looks = self.loss.scale, range(0, sys.maxsize, self.consistency_every)
        every: dict[str, tuple[float, Regularizer]] = {
            "consistency": (self.consistency, DepthNormals(scale * self.consistency, self.consistency_stride, looks)),
            "zero-one": (self.zero_one, ZeroOne(scale * self.zero_one)),
            "residuals": (
                self.residual_penalty,
                SmallColumn("columns.normal_residuals", scale * self.residual_penalty),
            ),
        }
        return {name: regularizer for name, (weight, regularizer) in every.items() if weight}

    def course(self, scene: "Scene") -> "Course":
        from ringlight.methods.assembly import Course

        of_dc, of_rest = harmonics_rates(self.sh_rate, self.sh_rest_rate, self.steps)
        held, of_light = self.rates.at_length(self.steps).held, self.light_rates

        def falling(rate: float) -> Adam:
            return Adam(Rate(rate, RATE_FALL * rate))

        return Course(
            groups={
                "columns.sh_dc": Adam(held(of_dc)),
                "columns.sh_rest": Adam(held(of_rest)),
                "columns.tint_logits": falling(of_light["material_rate"]),
                "columns.roughness_logits": falling(of_light["material_rate"]),
                "columns.normal_residuals": falling(of_light["normal_rate"]),
                "color.light.texels": falling(of_light["environment_rate"]),
            },
            unlocks={"color.harmonic.active_degree": degrees_by_step(self.sh_every, self.steps, self.sh_degree)},
            surface_opacity=self.start.opacity,
            coarse_steps=min(self.coarse_steps, self.steps // COARSE_SHARE),
            regularizers=self.regularizers(),
        )
