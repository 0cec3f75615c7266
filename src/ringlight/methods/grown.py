"""The bounds of a recipe whose Gaussians density control grows: every recipe is asked for them."""

from dataclasses import Field, replace
from typing import Any, ClassVar, TypeVar

from ringlight.fit.strategies.densify_settings import DensifySettings

Grown = TypeVar("Grown", bound="GrownByDensityControl")


class GrownByDensityControl:
    """Base of recipes with settings ``densify``."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]
    steps: int
    densify: DensifySettings

    @property
    def most(self) -> int | None:
        """How many Gaussians the user lets it end with; None where the photographs' pixels say so."""
        return self.densify.max_gaussians or None

    def ending_with(self: Grown, most: int | None, dropping: bool = True) -> Grown:
        """The same with this for ``most``; not ``dropping``, what density control grows is kept."""
        share = self.densify.drop_share if dropping else 0.0
        return replace(self, densify=replace(self.densify, max_gaussians=most or 0, drop_share=share))

    def never_above(self: Grown, most: int) -> Grown:
        """The same with no more than ``most`` at any step: it ends with what is left of them once some are dropped."""
        drops = bool(self.densify.drop_rounds(self.steps))
        return self.ending_with(max(int(most * (1 - self.densify.drop_share)), 1) if drops else most)
