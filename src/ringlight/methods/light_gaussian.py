"""light-gaussian: 3dgs with a third of its Gaussians, harmonics of lower degree, and a codebook of harmonics.

Fan, Wang, Wen, Zhu, Xu, Wang: LightGaussian: Unbounded 3D Gaussian Compression with 15x Reduction and 200+ FPS, NeurIPS
2024. Written from the paper. A run grows Gaussians as 3dgs does, unless it starts from a model of 3dgs; it drops those
that matter least and recovers on the photographs; it distils the harmonics; its last step quantises. What
differs from the paper: docs/methods/light-gaussian.md.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, ClassVar, Literal

from ringlight.core.later import later
from ringlight.errors import RecipeError
from ringlight.fit.rates import Adam, Part, Rate, RateInParts
from ringlight.methods.three_dgs import ThreeDGSRecipe

if TYPE_CHECKING:
    from jaxtyping import Float
    from torch import Tensor

    from ringlight.core.scene import PointCloud, Scene
    from ringlight.fit.train import Training
    from ringlight.models.narrowed_splats import NarrowedSplats
    from ringlight.rasterize.contract import Rasterizer

GROWN = 0.5
"""Share of the course of rates before the distillation from which a run takes them that starts from a model: it has
lost Gaussians, and the others learn anew."""

GROWING_DISTILLED, FINISHED_DISTILLED = 0.12, 0.7
"""Shares of the steps behind the growing: a model that has just been grown recovers the longer
(docs/methods/light-gaussian.md)."""

FINISHED_DISTILLED_BY_TEACHER = 0.3
"""The latter where no photograph teaches meanwhile."""

DISTILLING = Rate(0.5, 0.05)
"""Harmonics that are distilled learn at these shares of 3dgs's first rates, from the first step to the last."""

STILL = 0.0
"""Learning rate of opacities while harmonics are distilled, as in the paper."""

REST = "columns.sh_rest"


@dataclass(frozen=True)
class LightGaussianRecipe(ThreeDGSRecipe):
    """LightGaussian (Fan et al. 2023): 3dgs, then fewer Gaussians, distilled harmonics, and a codebook."""

    packings: ClassVar[tuple[tuple[str, str], ...]] = (
        (REST, "codebook8"),
        ("columns.log_scales", "fixed10"),
        ("columns.quats", "quaternions32"),
        ("columns.opacity_logits", "share8"),
        ("columns.sh_dc", "fixed10"),
        ("columns.*", "half"),
    )

    grow_share: float = 0.5
    """Share of the run after which Gaussians are dropped; until then they are grown as in 3dgs. The paper drops from
    finished models, or after two thirds of a run. 0 in runs that start --from a model of 3dgs."""
    distill_share: float | None = None
    """Share of the other steps in which harmonics are distilled; those before recover from the loss of Gaussians. By
    default 0.12 in a run that grows them, 0.7 of a finished model. The paper has 5,000 steps of each, and begins with
    harmonics that are cut; ours begin with a fit to what they showed."""
    photographs_teach: bool = later(False, now=True)
    """Whether photographs teach the harmonics where they were taken, one step in three, and the teacher elsewhere. The
    paper's teacher does everywhere."""
    prune_share: float = 0.5
    """Share of the Gaussians that is dropped. About as few as leave a file a twelfth of that of 3dgs; the paper has 0.6
    in a run that grows them, 0.66 of a finished model, and loses more."""
    prune_by: Literal["significance", "effects"] = later("significance", now="effects")
    """Which are dropped. effects: those whose removal would change the training pictures least. significance: those of
    least global significance, as in the paper, which is behind (docs/methods/light-gaussian.md)."""
    prune_rounds: int = 5
    """Rounds in which they are dropped, evenly over the first half of the recovery. The paper drops all at once."""
    volume_power: float = 0.1
    """Power of a Gaussian's volume in its global significance, by which the codebook weighs rows."""
    distilled_degree: int = 2
    """Degree of the spherical harmonics after the distillation, 0 to 3."""
    view_jitter: float = 0.01
    """Standard deviation of the offset of pseudo views along each axis, in units of the scene's extent. The paper has
    0.05 world units, which is 0.010 of the extent of Blender's scenes."""
    codebook_size: int = 8192
    """Most codes of harmonics; there is one for every six Gaussians that share them, if these are fewer."""
    codebook_share: float = 0.22
    """Share of the Gaussians, those that lose least by it, whose harmonics come from the codebook. The paper has 0.6,
    those of least global significance, and half floats where a file of ours has bytes and 10 bits."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._refuse_what_it_does_itself()
        for name in ("grow_share", "distill_share", "prune_share", "codebook_share"):
            if not 0 <= (getattr(self, name) or 0) <= 1:
                raise RecipeError(f"{name} is {getattr(self, name):g}; give a share, from 0 to 1")
        if self.prune_share == 1:
            raise RecipeError("prune_share is 1, which leaves no Gaussian; give less than 1")
        if self.prune_rounds < 1:
            raise RecipeError(f"prune_rounds is {self.prune_rounds}; give at least 1")
        if not 0 <= self.distilled_degree <= self.sh_degree:
            asked = f"distilled_degree is {self.distilled_degree}"
            raise RecipeError(f"{asked}; give 0 to sh_degree, which is {self.sh_degree}")
        if self.codebook_size < 0:
            raise RecipeError(f"codebook_size is {self.codebook_size}; give 0 (none) or more")
        if not (0 <= self.view_jitter < float("inf") and 0 <= self.volume_power < float("inf")):
            raise RecipeError("view_jitter or volume_power is negative or not finite; give 0 or more")

    def _refuse_what_it_does_itself(self) -> None:
        if self.densify.kind == "mcmc":
            raise RecipeError(
                "densify.kind is mcmc, and light-gaussian drops Gaussians by itself; use adaptive, or 3dgs"
            )
        for name, reason in (("dropout", "distils whole pictures"), ("average", "rounds its last step's model")):
            if getattr(self, name):
                raise RecipeError(
                    f"{name} is {getattr(self, name):g}, and light-gaussian {reason}; train 3dgs with it, then "
                    "light-gaussian --from that run"
                )

    @property
    def grown(self) -> int:
        """The step at which growing ends."""
        return round(self.grow_share * self.steps)

    @property
    def recovered(self) -> int:
        """The step after which harmonics are distilled."""
        return max(self.grown + round((1 - self._distilled) * (self.steps - self.grown)), 1)

    @property
    def _distilled(self) -> float:
        """The share of the steps behind the growing, as set or as suits what there is at their begin."""
        if self.distill_share is not None:
            return self.distill_share
        if self.grown:
            return GROWING_DISTILLED
        return FINISHED_DISTILLED if self.photographs_teach else FINISHED_DISTILLED_BY_TEACHER

    def prune_steps(self) -> tuple[int, ...]:
        """The steps after which Gaussians are dropped."""
        apart = (self.recovered - self.grown) / (2 * self.prune_rounds)
        return tuple(max(self.grown + round(apart * index), 1) for index in range(self.prune_rounds))

    def at_length(self) -> "LightGaussianRecipe":
        """See :meth:`SplatRecipe.at_length`. What photographs teach is a run of 3dgs up to the
        distillation, in the midst of which Gaussians are dropped."""
        taught = self._as_3dgs(self.recovered).at_length()
        open_settings = {
            name: getattr(taught, name) for name in ("rates", "densify", "start", "sh_rate", "sh_rest_rate")
        }
        return replace(self, **open_settings, distill_share=self._distilled)

    def _as_3dgs(self, steps: int) -> ThreeDGSRecipe:
        """The same settings as a recipe of 3dgs, so long."""
        settings = {field.name: getattr(self, field.name) for field in fields(ThreeDGSRecipe)}
        return ThreeDGSRecipe(**settings | {"steps": steps})

    def _growing(self) -> ThreeDGSRecipe:
        """What grows the Gaussians; a bound on those at the end is one on more before they are dropped."""
        grows = self._as_3dgs(self.recovered)
        grows = replace(grows, densify=replace(grows.densify, latest=min(grows.densify.latest, self.grown)))
        return grows.ending_with(int(self.most / (1 - self.prune_share))) if self.most else grows

    def without_effect(self) -> dict[str, str]:
        """See :meth:`SplatRecipe.without_effect`."""
        idle = {}
        if not self.prune_share:
            idle = dict.fromkeys(("prune_by", "prune_rounds"), "prune_share is 0, so that none is dropped")
        if not self.codebook_share:
            idle["codebook_size"] = "codebook_share is 0, so that there is no codebook"
        elif not self.codebook_size:
            idle["codebook_share"] = "codebook_size is 0, so that there is no codebook"
        by_significance = self.prune_share and self.prune_by == "significance"
        if not (by_significance or (self.codebook_share and self.codebook_size)):
            idle["volume_power"] = "nothing asks for global significance"
        if self.recovered == self.steps:
            idle |= dict.fromkeys(("view_jitter", "photographs_teach"), "no step distils")
        return super().without_effect() | idle

    def never_above(self, most: int) -> "LightGaussianRecipe":
        """See :meth:`SplatRecipe.never_above`."""
        return self.ending_with(max(int(most * (1 - self.prune_share)), 1))

    def as_stored(self, shapes: Mapping[str, tuple[int, ...]]) -> "LightGaussianRecipe":
        """The same without a distillation, for a file from before it."""
        whole = (self.sh_degree + 1) ** 2 - 1
        return replace(self, distilled_degree=self.sh_degree) if shapes.get(REST, ())[1:2] == (whole,) else self

    def model(self, box: "Float[Tensor, '2 3']", rasterize: "Rasterizer") -> "NarrowedSplats":
        from ringlight.methods.assembly import empty_model
        from ringlight.models.narrowed_splats import narrowed_splats

        distilled = replace(self._as_3dgs(self.steps), sh_degree=self.distilled_degree)
        return narrowed_splats(empty_model(distilled, box, rasterize), self.distilled_degree)

    def build_on(self, points: "PointCloud", scene: "Scene", rasterize: "Rasterizer", seed: int) -> "Training":
        """See :meth:`SplatRecipe.build_on`: a training of 3dgs, with what follows."""
        from ringlight.methods.lightening import lightened

        recipe = self.at_length()
        growing = recipe._growing().build_on(points, scene, rasterize, seed)
        return lightened(recipe, growing, scene, rasterize, seed)

    def groups(self, scene: "Scene") -> dict[str, Adam]:
        """Adam's, by parameter name: one course of rates until the distillation, another from there on."""
        recipe = self.at_length()
        taught = recipe._as_3dgs(self.recovered)
        whole = taught.rates.groups(scene.extent) | taught.course(scene).groups
        begun, end = (0.0 if self.grown else GROWN), self.recovered / self.steps
        groups = {}
        for name, group in whole.items():
            assert isinstance(group.rate, Rate)
            groups[name] = replace(
                group, rate=RateInParts((Part(end, group.rate, begun), Part(1.0, _after(name, group.rate))))
            )
        return groups


def _after(name: str, rate: Rate) -> Rate:
    """A parameter's rate while harmonics are distilled: they learn anew, opacities stay, the others go on."""
    if name.startswith("columns.sh_"):
        return Rate(DISTILLING.start * rate.start, DISTILLING.end * rate.start)
    return Rate.constant(STILL if name == "columns.opacity_logits" else rate.at(1.0))
