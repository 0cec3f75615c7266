"""What may be set of ringlight-mirror, and what follows from it before there are photographs."""

import math
from dataclasses import dataclass, field

from ringlight.core.kernel_limits import SH_MAX_BASIS
from ringlight.core.later import later
from ringlight.errors import RecipeError
from ringlight.fit.photometric import PhotometricLoss
from ringlight.fit.rates import FAST_SCALES, GaussianRates, check_rates
from ringlight.fit.strategies.densify_settings import PAPER_BEGIN, DensifySettings
from ringlight.methods.averaging import AVERAGED
from ringlight.methods.basis_rates import basis_rates
from ringlight.methods.splat_recipe import SplatRecipe
from ringlight.methods.warmup import check_warmup, unlit_share
from ringlight.shade.reflection_settings import ReflectionSettings

FAST_STEPS = 7_000
"""Up to which the weights learn fast. Slower ones are worth 2.3 and 0.7 dB on held-out views of chrome and of varnish
after 30,000 steps, and cost 0.1 and 0.05 after 7,000 (docs/experiments/mirrors.md)."""

OF_VARYING = ("sh_every", "weights_rate", "basis_rate", "varying_opacity", "opacity_basis_rate")
"""Settings that decide nothing where base colours are constant."""

OF_CONSISTENCY = ("consistency_stride", "consistency_every", "consistency_until")
"""Settings that decide nothing where normals need not agree with depths."""


@dataclass(frozen=True)
class MirrorSettings(SplatRecipe):
    """Base of the mirror's recipe: settings that are checked, and what follows from them and from the run's length."""

    steps: int = 30_000
    """Training steps, one photograph each."""
    warmup: float | None = None
    """Share of the steps with base colours only, before the shader is switched on. By default 0.05, and in runs of
    more than 3,000 steps what makes 150 steps; 0.1 where neither masks nor an even background cut the subject out."""
    opacity: float = 0.7
    """Of Gaussians at the start, if their points lie on a surface. From 0.3 the surface dissolves: 2.5 dB less."""
    start_share: float = 0.6
    """Gaussians at the start, as a share of the most that density control allows; the others grow where they are
    wanted."""
    base_rate: float = 1e-2
    """Learning rate of the base colours' logits."""
    normals_rate: float = 6e-3
    """Learning rate of the normals at the start; this one and the next five end at a tenth. The hull's normals have far
    to go: a third of this rate costs 0.3 dB in short runs."""
    latents_rate: float = 1e-2
    """Learning rate of the latents at the start."""
    maps_rate: float = 2e-2
    """Learning rate of the octahedral maps at the start."""
    network_rate: float = 3e-3
    """Learning rate of the shader's network, and of its ring if there is one, at the start."""
    axes_rate: float = 3e-3
    """Learning rate of the factors that the maps' features have at the reflecting point, at the start."""
    sphere_rate: float = 5e-3
    """Learning rate of the parallax spheres at the start."""
    light_hold: float = later(0.0, now=0.75)
    """Share of the lit steps in which the rates of shader, latents and weights are kept; then they fall to a tenth. 0:
    they fall all along, as the rate of the normals does in any case: to keep that too costs 0.1 to 0.5 dB
    (docs/experiments/mirrors.md)."""
    consistency: float = later(0.0, now=0.05)
    """Weight of 1 - cosine between blended normals and those of the blended depths; 0 for none. Without it the surface
    of a mirrored ball sinks into the images that it shows. Worth 0.9 dB on twelve balls; a toaster's chrome loses 0.1
    (docs/experiments/mirrors.md)."""
    consistency_stride: int = later(3)
    """Every so many rows and columns of pixels it is asked for, others each time."""
    consistency_every: int = later(4)
    """It is asked for in every so many-th step, and counts as often."""
    consistency_until: float = later(0.4)
    """Share of all steps until which it is asked for, from the first lit one on: that decides where the surface goes,
    and the rest is free."""
    undo_collapse: bool = later(False, now=True)
    """Whether a shader that collapses is noticed, and the run set back to where it was good, with half of the shader's
    rates from there on."""
    basis_size: int = later(0, now=4)
    """Weights of each Gaussian, of harmonics that all share, by which its base colour changes with the view: what one
    part of a scene reflects of another. 0 to 16; 0 keeps base colours constant."""
    sh_every: int = later(1000)
    """Steps after which one more degree of these harmonics is switched on (a seventh of the run if that is less)."""
    weights_rate: float | None = later(None)
    """Learning rate of the weights at the start; it ends at a tenth. By default 5e-3 in runs of up to 7,000 steps and
    3e-4 from 30,000 on, in between even in the logarithm of the steps."""
    basis_rate: float | None = later(None)
    """Learning rate of what is shared; it ends alike. By default twice the weights' default."""
    varying_opacity: bool = later(False, now=True)
    """Whether opacities change with the direction too, by the same weights, times functions of opacity that all
    Gaussians share: 0.25 dB on chrome and on a coat of varnish with 90 photographs, 0.0 and 0.1 with 45, nothing on
    balls, for no byte of a Gaussian and a twentieth more core seconds."""
    opacity_basis_rate: float | None = later(None)
    """Learning rate of the shared functions of opacity, which are logits; it ends alike. By default four times
    ``basis_rate``; a rate equal to that gains half as much on a coat of varnish."""
    antialiased: bool = True
    """Rasterize with the opacity compensation of Mip-Splatting, which is worth 0.4 dB on chrome."""
    visible_only: bool = False
    """Step only the Gaussians that the photograph shows; the others keep value and momentum."""
    average: float = later(0.0, now=AVERAGED)
    """The kept model is the mean of the models after each of the last steps, this share of the run, and none before the
    end of density control; 0 keeps the last model (docs/experiments/averaged-models.md)."""
    shader: ReflectionSettings = field(
        default_factory=lambda: ReflectionSettings(raw_direction=False, hidden=32, gradient_share=0.4, axis_nodes=16)
    )
    """What each pixel is shaded with. Without the viewing direction itself: from it the network learns views by heart,
    0.2 dB on held-out ones. Hidden layers of 64 would be worth 0.05 dB on chrome and 0.2 dB on a clear coat; they make
    a step a fifth longer. Four tenths of the pixels differentiated are within 0.1 dB of a half; a quarter is not on
    small photographs, 0.2 dB. Sixteen nodes an axis are worth 0.1 dB on test views of chrome and a clear coat, 0.5 dB
    on family_24; 64 learn chrome by heart."""
    rates: GaussianRates = field(default_factory=lambda: GaussianRates(means=3e-4, scales=FAST_SCALES, hold=1.0))
    """Learning rates of the geometry. Together with fewer Gaussians at the start they are worth half a decibel after
    3,000 steps, on chrome and on a clear coat, and nothing after 15,000."""
    densify: DensifySettings = field(
        default_factory=lambda: DensifySettings(begin=PAPER_BEGIN, reset_every=0, drop_share=0.3)
    )
    """Adaptive density control, without opacity resets, which would tear the surface open."""
    loss: PhotometricLoss = field(default_factory=PhotometricLoss)
    """What is compared with the photographs."""

    def __post_init__(self) -> None:
        self.check_shares()
        check_rates(**{name: value or 0.0 for name, value in vars(self).items() if name.endswith("_rate")})
        if not 0 <= self.basis_size <= SH_MAX_BASIS:
            raise RecipeError(f"basis_size is {self.basis_size}; give 0 (constant base colours) to {SH_MAX_BASIS}")
        check_warmup(self.warmup)
        if not 0 <= self.light_hold < 1:
            raise RecipeError(f"light_hold is {self.light_hold:g}; give a share of the steps, from 0 to below 1")
        for name in ("consistency_stride", "consistency_every"):
            if getattr(self, name) < 1:
                raise RecipeError(f"{name} is {getattr(self, name)}; give 1 (every one) or more")
        if not 0 <= self.consistency_until <= 1:
            raise RecipeError(
                f"consistency_until is {self.consistency_until:g}; give a share of all steps, from 0 to 1"
            )
        if not 0 <= self.consistency < math.inf:
            raise RecipeError(f"consistency is {self.consistency:g}; give a weight of 0 (none) or more")
        if not 0 < self.opacity < 1:
            raise RecipeError(f"opacity is {self.opacity:g}; an opacity lies between 0 and 1")
        if not 0 < self.start_share <= 1:
            raise RecipeError(f"start_share is {self.start_share:g}; give a share above 0, at most 1")

    def without_effect(self) -> dict[str, str]:
        """See :meth:`SplatRecipe.without_effect`."""
        varying = {} if self.basis_size else dict.fromkeys(OF_VARYING, "--basis-size is 0")
        if self.basis_size and not self.varying_opacity:
            varying = {"opacity_basis_rate": "--no-varying-opacity is given"}
        consistent = {} if self.consistency else dict.fromkeys(OF_CONSISTENCY, "--consistency is 0")
        if self.consistency and not self.consistency_steps:
            reason = f"no step is lit until --consistency-until {self.consistency_until:g} of the run"
            consistent = dict.fromkeys(("consistency", *OF_CONSISTENCY), reason)
        return super().without_effect() | varying | consistent

    @property
    def varying_rates(self) -> tuple[float, float, float]:
        """Of the weights, and of shared functions of colour and opacity, as set or as suits the run's length."""
        return basis_rates(self.steps, FAST_STEPS, self.weights_rate, self.basis_rate, self.opacity_basis_rate)

    @property
    def unlit_share(self) -> float:
        """Of the steps, those with base colours only: as set, or as suits the run's length."""
        return unlit_share(self.warmup, self.steps)

    @property
    def first_lit(self) -> int:
        """Step after which the light is on."""
        return max(int(self.unlit_share * self.steps), 1)

    @property
    def consistency_steps(self) -> range:
        """At which normals are asked to agree with depths: lit ones, since before these nothing else moves normals."""
        if not self.consistency:
            return range(0)
        every = self.consistency_every
        return range((self.first_lit // every + 1) * every, int(self.consistency_until * self.steps) + 1, every)
