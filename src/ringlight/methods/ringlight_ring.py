"""ringlight-ring: base colour per Gaussian plus a view-dependent residual from one shared neural tensor ring.

Anonymous: RingLight-GS, a Compact and Expressive Framework for Modeling Scene Color in 3DGS, 2025. Two presets: PAPER
takes the paper at its word; the default is ours, which keeps the form and changes what measurements say (see the
fields' docstrings).
"""

import dataclasses
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ringlight.color.ringlight_settings import RingLightSettings
from ringlight.core.later import later
from ringlight.errors import RecipeError
from ringlight.fields.ring_settings import RingSettings
from ringlight.fit.photometric import PhotometricLoss
from ringlight.fit.rates import (
    FAST_SCALES,
    PAPER_MEANS,
    PAPER_OPACITIES,
    PAPER_SCALES,
    Adam,
    GaussianRates,
    Rate,
    check_fall,
    check_rates,
)
from ringlight.fit.strategies.densify_settings import PAPER_BEGIN, PAPER_CLONE_BELOW, DensifySettings
from ringlight.methods.averaging import AVERAGED
from ringlight.methods.splat_recipe import SplatRecipe
from ringlight.methods.warmup import check_warmup

if TYPE_CHECKING:
    from jaxtyping import Float
    from torch import Tensor

    from ringlight.color.contract import ColorModel
    from ringlight.core.scene import Scene
    from ringlight.methods.assembly import Course
    from ringlight.shade.contract import Shader

PRUNE_ROUNDS = 15
"""Removals of faint and masked rows after densification: every 1000 steps of the paper's 30,000."""

PAPER_SCALE = 1e4
"""The paper's gamma, equation 9."""

PAPER_POINTS = 100_000
"""Random points of 3DGS, whose settings the paper takes where it names none."""

OURS = RingLightSettings(
    ring=RingSettings(rank=8, features=24, head_hidden=64, position_nodes=256, view_bands=4, view_nodes=24),
    render_hidden=64,
    modulation_hidden=64,
    latents=4,
    gradient_share=0.25,
)
"""Narrower than the paper's field: rank 16 with 48 features doubles the cost of a step for 0.1 dB on NeRF-Synthetic's
chair. Four latents give each Gaussian a say in how it reflects, for 0.5 dB there. Four view bands do not alias in a
small table: 0.3 dB over ten. Networks of width 32 and 16 take a tenth less time a step, and collapsed on lego_400
(docs/experiments/light-fields.md)."""


@dataclass(frozen=True)
class RingLightRingRecipe(SplatRecipe):
    """RingLight-GS: Gaussians lit by one shared neural tensor-ring light field."""

    steps: int = 30_000
    """Training steps, one photograph each."""
    warmup: float = 0.2
    """Share of the steps with base colour only, before the light field is switched on. The paper takes 0.1, which in
    short runs is just before the first opacity reset and costs 0.3 dB."""
    base_rate: float = 1e-2
    """Learning rate of the base colours' logits. A step moves a grey by a quarter of it, a colour of 0.1 or 0.9 by a
    tenth, which is about the pace of 3DGS's constant coefficient."""
    latents_rate: float = 1e-2
    """Learning rate of the latents when the light field is switched on; it ends at a tenth."""
    mask_rate: float = 0.01
    """Learning rate of the mask logits."""
    mask_penalty: float = 0.0
    """Weight of the mean mask in the loss; the paper has none."""
    field_rate: float = 2e-3
    """Learning rate of the light field and the render module when they are switched on. Far higher ones collapse."""
    field_rate_end: float = 1e-4
    """And at the end of the run, log-linear in between; the paper keeps 1e-4 all along."""
    field_beta2: float = 0.999
    """How much of its mean of squared gradients the light field's Adam keeps at a step. With 0.999, the usual, a jump
    of the gradients makes steps up to five times as long as the rate; with 0.99 twice as long."""
    field_epsilon: float = 1e-15
    """Epsilon of the light field's Adam; with it the loss's scale (gamma) has no effect."""
    undo_collapse: bool = later(False, now=True)
    """Whether a light field that collapses is noticed, and the run set back to where it was good, with half of the
    field's rate from there on."""
    antialiased: bool = False
    """Rasterize with the opacity compensation of Mip-Splatting."""
    random_points: int = later(0)
    """Random points to start from where the scene brings none and --initial-points states no number. 0: by the
    photographs' size, 20,000 up to 200 pixels a side and 100,000 above."""
    visible_only: bool = False
    """Step only the Gaussians that the photograph shows; the others keep value and momentum (faster, not the paper)."""
    average: float = later(0.0, now=AVERAGED)
    """The kept model is the mean of the models after each of the last steps, this share of the run, and none before the
    end of density control; 0 keeps the last model (docs/experiments/averaged-models.md)."""
    light: RingLightSettings = field(default_factory=lambda: OURS)
    """The light field and the render module."""
    rates: GaussianRates = field(default_factory=lambda: GaussianRates(means=PAPER_MEANS, scales=FAST_SCALES, hold=1.0))
    """Learning rates of the geometry. Scales that begin four times as fast as 3DGS's gain 0.3 dB on chair_400 and 1 dB
    on lego_400 after 3,000 steps, with somewhat fewer Gaussians."""
    densify: DensifySettings = field(
        default_factory=lambda: DensifySettings(begin=PAPER_BEGIN, threshold=7.5e-5, drop_share=0.6, drop_by="effects")
    )
    """Adaptive density control. The paper's threshold, 1.1, divided by its gamma is 1.1e-4. Two thirds of it grow more,
    of which the better two fifths are kept: under a third of 3DGS's raw bytes, and on chair_400 0.5 dB more than as
    many that grow by 1.3e-4 and are all kept. That was by blending weights; effects give 0.15 dB more."""
    loss: PhotometricLoss = field(default_factory=lambda: PhotometricLoss(pixel="l2"))
    """What is compared with the photographs (equation 9)."""

    def __post_init__(self) -> None:
        self.check_shares()
        check_rates(**{name: value for name, value in vars(self).items() if name.endswith(("_rate", "_rate_end"))})
        check_warmup(self.warmup)
        if not 0 <= self.mask_penalty < math.inf:
            raise RecipeError(f"mask_penalty is {self.mask_penalty:g}; give 0 (none) or more")
        if not 0 <= self.field_beta2 < 1:
            raise RecipeError(f"field_beta2 is {self.field_beta2:g}; give 0 or more, and less than 1")
        if self.random_points < 0:
            raise RecipeError(f"random_points is {self.random_points}; give 0 (by the photographs' size) or more")
        if not 0 < self.field_epsilon < math.inf:
            raise RecipeError(f"field_epsilon is {self.field_epsilon:g}; give a number above zero")

    def parts(self, box: "Float[Tensor, '2 3']", seed: int = 0) -> "tuple[ColorModel, Shader]":
        from ringlight.color.ringlight import RingLight
        from ringlight.shade.passthrough import PassThrough

        return RingLight(self.light, box, seed), PassThrough()

    def course(self, scene: "Scene") -> "Course":
        from ringlight.core.gradients import COLOR
        from ringlight.fit.regularizers.mean_mask import MeanMask
        from ringlight.fit.strategies.prune import Prune
        from ringlight.methods.assembly import Course

        first_lit = max(int(self.warmup * self.steps), 1) if self.light.base_color else 1
        check_fall("field_rate_end", self.field_rate, self.field_rate_end)
        rate, betas = Rate(self.field_rate, self.field_rate_end), (0.9, self.field_beta2)
        last = self.densify.last_step(self.steps)
        every = max((self.steps - last) // PRUNE_ROUNDS, 1)
        prune = Prune(last, every, self.densify.prune_opacity, until=self.averaged_from)
        penalized = self.mask_penalty and self.light.mask
        return Course(
            groups={
                "columns.base": Adam(Rate.constant(self.base_rate)),
                "columns.latents": Adam(Rate(self.latents_rate, self.latents_rate / 10), begins=first_lit),
                "columns.mask_logits": Adam(Rate.constant(self.mask_rate)),
                "color.*": Adam(rate, betas, self.field_epsilon, begins=first_lit),
            },
            unlocks={"color.lit": {first_lit: 1}},
            light=(COLOR,) if self.undo_collapse else (),
            first_lit=first_lit,
            last=lambda _control, _seed: (prune,) if self.densify.prunes else (),
            regularizers={"mask": MeanMask(self.mask_penalty * self.loss.scale)} if penalized else {},
        )


PAPER = dataclasses.replace(
    RingLightRingRecipe(),
    rates=GaussianRates(means=PAPER_MEANS, opacities=PAPER_OPACITIES, scales=PAPER_SCALES, hold=1.0),
    random_points=PAPER_POINTS,
    warmup=0.1,
    average=0.0,
    light=RingLightSettings(ring=RingSettings(core="network"), clamp_colors=False, gradient_share=0.25),
    field_rate=1e-4,
    field_rate_end=1e-4,
    field_epsilon=1e-8,
    undo_collapse=False,
    densify=DensifySettings(begin=PAPER_BEGIN, threshold=1.1, clone_below=PAPER_CLONE_BELOW, pixel_bound=False),
    loss=PhotometricLoss(pixel="l2", scale=PAPER_SCALE),
)
"""The paper's settings, statement by statement in docs/reproduction.md.

It gives the Gaussians a rate of 0.0025 and does not say how base colours are stored: 0.01 on their logits moves a grey
by 0.0025 a step (``--base-rate 2.5e-3`` for 0.0025 on logits). Two means of speed are ours: heads are tabulated
(``--light.evaluation exact`` for none), and the light's gradient is importance-sampled, a quarter of the Gaussians
(``--light.gradient-share 1`` for all)."""
