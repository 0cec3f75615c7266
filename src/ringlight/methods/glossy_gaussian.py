"""glossy-gaussian: 3dgs whose opacities depend on the direction too.

Zhang, Wang, Zhan, Wang: Glossy-Gaussian, IEEE Signal Processing Letters 2025. Written from facts about the paper, not
from its program. All else is as in 3dgs. What differs: docs/methods/glossy-gaussian.md.
"""

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from ringlight.errors import RecipeError
from ringlight.fit.rates import Adam, check_rates, shorter_by
from ringlight.fit.strategies.densify_settings import DensifySettings
from ringlight.methods.three_dgs import HIGHEST_DEGREE, ThreeDGSRecipe, degrees_by_step

if TYPE_CHECKING:
    from jaxtyping import Float
    from torch import Tensor

    from ringlight.color.contract import ColorModel
    from ringlight.core.scene import Scene
    from ringlight.methods.assembly import Course
    from ringlight.shade.contract import Shader

PAPER_REST_RATE = 1.25e-4
"""Glossy-Gaussian's learning rate of the opacity's harmonics after the constant one, a twentieth of 2.5e-3."""

MOST_REST = 5
"""Times this is it at most, however short the run. Fifteen times as fast in 2,000 steps shows held-out views of a
toaster as well, with a quarter more Gaussians and a lower SSIM."""


def opacity_rest_rate_at(rate: float | None, steps: int) -> float:
    """``rate``, or what suits a run of so many ``steps``."""
    return PAPER_REST_RATE * min(shorter_by(steps), MOST_REST) if rate is None else rate


@dataclass(frozen=True)
class GlossyGaussianRecipe(ThreeDGSRecipe):
    """Glossy-Gaussian (Zhang et al. 2025): 3dgs with opacities that are harmonics of the direction."""

    opacity_degree: int = HIGHEST_DEGREE
    """Degree of the opacities' harmonics, 0 to 3; their degree rises when that of the colours does."""
    opacity_rest_rate: float | None = None
    """Learning rate of the opacities' harmonics after the constant one, in units of opacity. By default the paper's
    1.25e-4 in a run of 30,000 steps or more; a run half as long takes twice of it, and none more than 6.25e-4."""
    densify: DensifySettings = field(default_factory=DensifySettings)
    """Density control, which goes by the mean opacity over all directions, and resets that. The paper has no resets
    (``reset_every`` of 0)."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.opacity_degree <= HIGHEST_DEGREE:
            raise RecipeError(f"opacity_degree is {self.opacity_degree}; give 0 to {HIGHEST_DEGREE}")
        check_rates(opacity_rest_rate=self.opacity_rest_rate or 0.0)

    def at_length(self) -> "GlossyGaussianRecipe":
        """See :meth:`SplatRecipe.at_length`."""
        settled = super().at_length()
        assert isinstance(settled, GlossyGaussianRecipe)
        return replace(settled, opacity_rest_rate=opacity_rest_rate_at(self.opacity_rest_rate, self.steps))

    def parts(self, box: "Float[Tensor, '2 3']", seed: int = 0) -> "tuple[ColorModel, Shader]":
        from ringlight.color.glossy_harmonics import GlossyHarmonics
        from ringlight.shade.passthrough import PassThrough

        return GlossyHarmonics(self.sh_degree, self.opacity_degree), PassThrough()

    def course(self, scene: "Scene") -> "Course":
        of_3dgs = super().course(scene)
        of_rest = opacity_rest_rate_at(self.opacity_rest_rate, self.steps)
        held = self.rates.at_length(self.steps).held
        return replace(
            of_3dgs,
            groups={**of_3dgs.groups, "columns.opacity_rest": Adam(held(of_rest))},
            unlocks={
                "color.harmonic.active_degree": degrees_by_step(self.sh_every, self.steps, self.sh_degree),
                "color.active_opacity_degree": degrees_by_step(self.sh_every, self.steps, self.opacity_degree),
            },
        )
