"""ringlight-basis: harmonics mixed of a few that all Gaussians share, and as many weights for each Gaussian.

Ours. What the paper's light field is to the place and the direction, a tensor of low rank, this is to the Gaussian and
the direction (``color/shared_basis.py``). The same weights move opacities (``color/basis_opacities.py``). Training is
3DGS's (Kerbl et al. 2023), with growing and dropping.
"""

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from ringlight.core.kernel_limits import SH_MAX_BASIS
from ringlight.core.later import LATER, later
from ringlight.errors import RecipeError
from ringlight.fit.photometric import PhotometricLoss
from ringlight.fit.rates import Adam, GaussianRates, check_rates
from ringlight.fit.strategies.densify_settings import DensifySettings
from ringlight.methods.basis_rates import basis_rates
from ringlight.methods.splat_recipe import SplatRecipe
from ringlight.methods.surface_start import SurfaceStart
from ringlight.methods.three_dgs import COARSE_SHARE, degrees_by_step, harmonics_rates

if TYPE_CHECKING:
    from jaxtyping import Float
    from torch import Tensor

    from ringlight.color.contract import ColorModel
    from ringlight.core.scene import Scene
    from ringlight.fit.train import Training
    from ringlight.methods.assembly import Course
    from ringlight.rasterize.contract import Rasterizer
    from ringlight.shade.contract import Shader

HOLD = 0.75
"""Of the run, of any length: a quarter of it, after the last Gaussians are dropped, settles what was learned at high
rates. Worth 0.1 dB after 3,000 and 7,000 steps; rates that fall all along cost 0.8 dB."""

GAUSSIANS_A_PIXEL = 0.85
"""At its end, if nobody says so. Where 3dgs has a Gaussian a pixel, its own bound, it takes three times the raw bytes;
long runs reach both bounds."""


FAST_STEPS = 3_000
"""After 7,000 steps at rates around the one that lies between, maryrose_400 has 0.3 to 0.5 dB more on held-out views;
chair_400 and lego_400 are level (docs/experiments/shared-basis.md)."""


@dataclass(frozen=True)
class RingLightBasisRecipe(SplatRecipe):
    """Gaussians with a few weights of harmonics that all share."""

    steps: int = 30_000
    """Training steps, one photograph each."""
    coarse_steps: int = 700
    """Steps with photographs at a quarter of their size, and as many again at half (a tenth of the run if that is
    less); 0 for none."""
    basis_size: int = 8
    """Shared functions of the direction, and weights of each Gaussian, 1 to 16."""
    sh_every: int = 1000
    """Steps after which one more degree of the harmonics is switched on (a seventh of the run if that is less)."""
    sh_rate: float | None = None
    """Learning rate of the constant coefficients, by default as that of 3dgs in a run of this length."""
    weights_rate: float | None = None
    """Learning rate of the weights; it falls with the base colours', see rates.hold. By default 5e-3 in runs of up to
    3,000 steps, 1.8e-3 in those of 7,000 and 3e-4 from 30,000 steps on."""
    basis_rate: float | None = None
    """Learning rate of what is shared; it falls alike. By default twice the weights' default."""
    varying_opacity: bool = later(False, now=True)
    """Whether opacities change with the direction too, by the same weights and functions of their own that all share.
    Worth 0.5 dB on chair_400 for no byte of a Gaussian. Programs that know harmonics alone are given fitted ones."""
    opacity_basis_rate: float | None = later(None)
    """Learning rate of the shared functions of opacity; it falls alike. By default four times ``basis_rate``."""
    start: SurfaceStart = field(default_factory=SurfaceStart)
    """Where Gaussians start."""
    antialiased: bool = False
    """Rasterize with the opacity compensation of Mip-Splatting."""
    visible_only: bool = False
    """Step only the Gaussians that the photograph shows; the others keep value and momentum."""
    average: float = later(0.0)
    """The kept model is the mean of the models after each of the last steps, this share of the run, and none before the
    end of density control; 0 keeps the last model."""
    dropout: float | None = field(default=None, metadata={LATER: 0.0})
    """Share of the Gaussians that a training picture goes without, drawn anew for each in the second half of the run,
    once density control adds none. By default a tenth with fewer than 18 photographs, else 0, none
    (docs/experiments/dropout.md)."""
    rates: GaussianRates = field(default_factory=lambda: GaussianRates(hold=HOLD))
    """Learning rates of the geometry, and when rates fall."""
    densify: DensifySettings = field(
        default_factory=lambda: DensifySettings(
            threshold=None, drop_share=None, drop_by="effects", drop_hidden=None, reset_every=0
        )
    )
    """Adaptive density control. Without opacity resets: 0.2 dB more on chair_400 after 3,000 steps."""
    loss: PhotometricLoss = field(default_factory=PhotometricLoss)
    """What is compared with the photographs."""

    def __post_init__(self) -> None:
        if self.coarse_steps < 0:
            raise RecipeError(f"coarse_steps is {self.coarse_steps}; give 0 (none) or more")
        if not 1 <= self.basis_size <= SH_MAX_BASIS:
            raise RecipeError(f"basis_size is {self.basis_size}; give 1 to {SH_MAX_BASIS}")
        self.check_shares()
        check_rates(**{name: value or 0.0 for name, value in vars(self).items() if name.endswith("_rate")})

    def at_length(self) -> "RingLightBasisRecipe":
        """See :meth:`SplatRecipe.at_length`."""
        of_dc, _ = harmonics_rates(self.sh_rate, None, self.steps)
        of_weights, of_basis, of_opacities = self.light_rates
        settled = replace(super().at_length(), sh_rate=of_dc)
        settled = replace(settled, weights_rate=of_weights, basis_rate=of_basis)
        return replace(settled, opacity_basis_rate=of_opacities) if self.varying_opacity else settled

    @property
    def light_rates(self) -> tuple[float, float, float]:
        """Of the weights, and of shared functions of colour and opacity, as set or as suits the run's length."""
        return basis_rates(self.steps, FAST_STEPS, self.weights_rate, self.basis_rate, self.opacity_basis_rate)

    def without_effect(self) -> dict[str, str]:
        """See :meth:`SplatRecipe.without_effect`."""
        unused = {} if self.varying_opacity else {"opacity_basis_rate": "--no-varying-opacity is given"}
        return super().without_effect() | unused

    def build(self, scene: "Scene", rasterize: "Rasterizer", seed: int) -> "Training":
        return self.build_on(self.start.points_in(scene, seed), scene, rasterize, seed)

    def most_by_pixels(self, pixels: int) -> int:
        """See :meth:`SplatRecipe.most_by_pixels`."""
        usual = self.densify.usual_bound(pixels)
        return math.ceil(GAUSSIANS_A_PIXEL * usual) if self.densify.kind == "adaptive" else usual

    def parts(self, box: "Float[Tensor, '2 3']", seed: int = 0) -> "tuple[ColorModel, Shader]":
        from ringlight.color.basis_opacities import BasisOpacities
        from ringlight.color.shared_basis import SharedBasis
        from ringlight.shade.passthrough import PassThrough

        return (BasisOpacities if self.varying_opacity else SharedBasis)(self.basis_size, seed), PassThrough()

    def course(self, scene: "Scene") -> "Course":
        from ringlight.methods.assembly import Course

        of_dc, _ = harmonics_rates(self.sh_rate, None, self.steps)
        of_weights, of_basis, of_opacities = self.light_rates
        held = self.rates.at_length(self.steps).held
        opacities = {"color.opacity_basis": Adam(held(of_opacities))} if self.varying_opacity else {}
        return Course(
            groups={
                "columns.sh_dc": Adam(held(of_dc)),
                "columns.basis_weights": Adam(held(of_weights)),
                "color.basis": Adam(held(of_basis)),
                **opacities,
            },
            unlocks={"color.active_degree": degrees_by_step(self.sh_every, self.steps)},
            surface_opacity=self.start.opacity,
            coarse_steps=min(self.coarse_steps, self.steps // COARSE_SHARE),
        )
