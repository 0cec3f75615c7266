"""What recipes of methods that splat Gaussians have in common: a recipe says its parts and how they are trained."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import Field, replace
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

from ringlight.core.words import counted
from ringlight.errors import RecipeError
from ringlight.fit.photometric import PhotometricLoss
from ringlight.fit.rates import GaussianRates
from ringlight.fit.strategies.densify_settings import OF_DROPPING, DensifySettings
from ringlight.methods.averaging import check_average, first_averaged
from ringlight.methods.surface_start import SurfaceStart

if TYPE_CHECKING:
    from jaxtyping import Float
    from torch import Tensor

    from ringlight.color.contract import ColorModel
    from ringlight.core.scene import PointCloud, Scene
    from ringlight.fit.train import Training
    from ringlight.methods.assembly import Course
    from ringlight.methods.recipe import Recipe
    from ringlight.models.splats import SplatModel
    from ringlight.rasterize.contract import Rasterizer
    from ringlight.shade.contract import Shader

FEW_PHOTOGRAPHS_DROPOUT = 0.1
"""A share of the Gaussians; 0.2 is better on chair_400 and worse on lego_400 (docs/experiments/dropout.md)."""

FEWEST_WITHOUT_DROPOUT = 18
"""Photographs: nine tenths of 20, so that ``--validate`` on 20 trains as the run that it stands for. With 12 and 16
dropout gains 0.1 to 0.8 dB on held-out views, with 24 0.1 on the mean of three scenes, with 40 it loses 0.3 and 0.4 on
one (docs/experiments/dropout.md); in between nothing was measured."""

DROPOUT_BEGINS = 0.5
"""Of the run; an earlier beginning was not measured."""

Splats = TypeVar("Splats", bound="SplatRecipe")


class SplatRecipe(ABC):
    """Base of recipes whose Gaussians density control grows, and whose settings hardly depend on the scene."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]
    packings: ClassVar[tuple[tuple[str, str], ...]] = ()
    steps: int
    antialiased: bool = False
    visible_only: bool = False
    dropout: float | None = 0.0
    average: float = 0.0
    random_points: int = 0
    start: SurfaceStart | None = None
    rates: GaussianRates
    densify: DensifySettings
    loss: PhotometricLoss

    def check_shares(self) -> None:
        """Raise RecipeError for a dropout or an average that is no share."""
        check_average(self.average)
        if self.dropout is not None and not 0 <= self.dropout < 1:
            raise RecipeError(f"dropout is {self.dropout:g}; give a share from 0 (none) to less than 1")

    def dropout_of(self, photographs: int) -> float:
        """The share of Gaussians that a picture of so many goes without."""
        if self.dropout is not None:
            return self.dropout
        return FEW_PHOTOGRAPHS_DROPOUT if photographs < FEWEST_WITHOUT_DROPOUT else 0.0

    @property
    def last_whole_step(self) -> int:
        """The last step whose picture has all Gaussians. Density control is over then: pictures with holes would
        mislead its statistics."""
        return max(int(DROPOUT_BEGINS * self.steps), self.densify.last_step(self.steps))

    @property
    def averaged_from(self) -> int | None:
        """First step whose model counts in the mean; None where the last is kept. Density control is over then."""
        return first_averaged(self.average, self.steps, self._last_reshaped)

    @property
    def _last_reshaped(self) -> int:
        """The last step after which rows may be added, or are dropped in rounds."""
        return max(self.densify.last_step(self.steps), *self.densify.drop_rounds(self.steps), 0)

    @abstractmethod
    def parts(self, box: "Float[Tensor, '2 3']", seed: int = 0) -> "tuple[ColorModel, Shader]":
        """What a picture is made with, but for the Gaussians; networks and maps as ``seed`` draws them."""

    @abstractmethod
    def course(self, scene: "Scene") -> "Course":
        """How these are trained."""

    def settled(self: Splats, scene: "Scene", rasterize: "Rasterizer", seed: int) -> tuple[Splats, None]:
        """With everything decided that depends on the run's length, and on how many photographs there are."""
        settled, photographs = self.at_length(), len(scene.train)
        if settled.dropout is None:
            settled = replace(settled, dropout=settled.dropout_of(photographs))
        if settled.start is None:
            return settled, None
        return replace(settled, start=settled.start.for_photographs(photographs)), None

    def may_settle_on(self, other: "Recipe") -> bool:
        """Whether it is this one at its length, their bounds, what decides nothing and what is left to photographs
        aside."""
        if not isinstance(other, SplatRecipe):
            return False
        if self.start is not None and self.start.form is None and other.start is not None:
            other = replace(other, start=other.start.left_to_photographs().at_length())
        if self.dropout is None and isinstance(other, type(self)) and other.dropout in (0.0, FEW_PHOTOGRAPHS_DROPOUT):
            other = replace(other, dropout=None)
        return _deciding(other) == _deciding(self.at_length())

    def at_length(self: Splats) -> Splats:
        """The same with what is left to the run's length decided; ``steps`` is that of the run."""
        settled = replace(self, rates=self.rates.at_length(self.steps), densify=self.densify.at_length(self.steps))
        return settled if self.start is None else replace(settled, start=self.start.at_length())

    def build(self, scene: "Scene", rasterize: "Rasterizer", seed: int) -> "Training":
        return self.build_on(scene.points, scene, rasterize, seed)

    def build_on(self, points: "PointCloud", scene: "Scene", rasterize: "Rasterizer", seed: int) -> "Training":
        """The same from these points, bounded as ``densify`` says."""
        from ringlight.methods.assembly import assembled

        return assembled(self, points, scene, rasterize, seed)

    def model(self, box: "Float[Tensor, '2 3']", rasterize: "Rasterizer") -> "SplatModel":
        from ringlight.methods.assembly import empty_model

        return empty_model(self, box, rasterize)

    def as_stored(self: Splats, shapes: Mapping[str, tuple[int, ...]]) -> Splats:
        """Itself: columns keep their width."""
        return self

    def most_by_pixels(self, pixels: int) -> int:
        """How many Gaussians it ends with where nobody says so; ``pixels`` are those of the largest training
        photograph."""
        return self.densify.usual_bound(pixels)

    @property
    def most(self) -> int | None:
        """How many Gaussians the user lets it end with; None where the photographs' pixels say so."""
        return self.densify.max_gaussians or None

    def ending_with(self: Splats, most: int | None, dropping: bool = True) -> Splats:
        """The same with this for ``most``; not ``dropping``, what density control grows is kept."""
        share = self.densify.drop_share if dropping else 0.0
        return replace(self, densify=replace(self.densify, max_gaussians=most or 0, drop_share=share))

    def without_effect(self) -> dict[str, str]:
        """Settings of density control, and what waits for its end, that decide nothing as the others are, and why."""
        idle, densify = self.densify.without_effect(), self.densify
        if densify.growth(self.steps).drop_share and not densify.drop_rounds(self.steps):
            last = densify.last_step(self.steps)
            reason = (
                f"a run of {counted(self.steps, 'step')} that adds Gaussians until step {last} has no room to drop any"
            )
            idle = dict.fromkeys(("drop_share", *OF_DROPPING), reason) | idle
        averaging = {}
        if self.average and self.averaged_from is None:
            asked = counted(round(self.average * self.steps), "step")
            averaging = {"average": f"fewer than two of the last {asked}, of {self.steps}, come after density control"}
        return averaging | {f"densify.{name}": reason for name, reason in idle.items()}

    def never_above(self: Splats, most: int) -> Splats:
        """The same with no more than ``most`` at any step: it ends with what is left of them once some are dropped."""
        drops = bool(self.densify.drop_rounds(self.steps))
        return self.ending_with(max(int(most * (1 - self.densify.growth(self.steps).drop_share)), 1) if drops else most)


def _deciding(recipe: SplatRecipe) -> SplatRecipe:
    """Without a bound, and without what decides nothing in its density control: a record has the usual settings of the
    version that wrote it."""
    free = recipe.ending_with(None)
    return replace(free, densify=free.densify.deciding())
