"""Where Gaussians start if masks cut the subject out of the photographs: on or in its visual hull. Torch-free."""

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

from ringlight.core.later import LATER
from ringlight.errors import RecipeError

if TYPE_CHECKING:
    from ringlight.core.scene import PointCloud, Scene

FEWEST_VIEWS = 12
"""Photographs; the hull of fewer is a rough guess."""

FEWEST_FOR_DISCS = 54
"""Photographs. The hull of fewer is too wide, and half opaque discs on its surface hide what lies within: with 40 they
cost lego_400 a decibel, with 60 they gain 0.3 (docs/experiments/few-photographs.md); in between nothing was measured.
Nine tenths of 60 are what --validate trains on."""

FIRST_GAUSSIANS = 20_000
"""On the hull; half of them cost 0.2 dB on chair_400, twice of them only add Gaussians."""


@dataclass(frozen=True)
class SurfaceStart:
    """Gaussians drawn from the visual hull of the photographs' masks."""

    points: int = FIRST_GAUSSIANS
    """Gaussians to start with, drawn from the visual hull of the photographs' masks. 0 starts from the scene's points,
    or random ones, and so do scenes without masks or with fewer than 12 photographs."""
    opacity: float = 0.5
    """Of discs at the start; balls have 0.1 whatever this is."""
    form: Literal["discs", "balls"] | None = field(default=None, metadata={LATER: "discs"})
    """discs lie in the hull's surface; balls are faint, and anywhere in the hull. By default discs from 54 photographs
    on, else balls (docs/experiments/few-photographs.md). Methods that mirror at normals take discs alone."""

    def __post_init__(self) -> None:
        if self.points < 0:
            raise RecipeError(f"start.points is {self.points}; give 0 (the scene's points) or more")
        if not 0 < self.opacity < 1:
            raise RecipeError(f"start.opacity is {self.opacity:g}; an opacity lies between 0 and 1")

    def for_photographs(self, count: int) -> "SurfaceStart":
        """The same with the form decided; discs where nothing starts on a hull, as in files that know no form."""
        if self.form is not None:
            return self
        return replace(self, form="balls" if self.points and count < FEWEST_FOR_DISCS else "discs")

    def at_length(self) -> "SurfaceStart":
        """The same with the form decided where no photograph has a say: nothing starts on a hull."""
        return self if self.points else self.for_photographs(0)

    def left_to_photographs(self) -> "SurfaceStart":
        """The same with the form left to them."""
        return replace(self, form=None)

    def points_in(self, scene: "Scene", seed: int) -> "PointCloud":
        """Points of the hull, or else the scene's own. The hull takes some seconds."""
        from ringlight.data.hull import masks_of
        from ringlight.data.surface import points_in_hull, points_on_hull

        if not self.points or len(scene.train) < FEWEST_VIEWS:
            return scene.points
        form = self.for_photographs(len(scene.train)).form
        drawn = points_in_hull if form == "balls" else points_on_hull
        return drawn(masks_of(scene.train), scene, self.points, seed) or scene.points

    def with_normals_in(self, scene: "Scene", seed: int) -> "PointCloud":
        """Where methods start that mirror at normals: points of the hull, of masks or of an even background, or else
        the scene's own with normals of the planes through them; without ``points`` the scene's as they are.

        Raises RecipeError where the form is balls, which have no normals.
        """
        from ringlight.data.surface import hull_points, own_points

        if self.form == "balls":
            raise RecipeError(f"start.form is {self.form}; a method that mirrors at normals starts from discs")
        if not self.points:
            return scene.points
        found = hull_points(scene, self.points, seed) if len(scene.train) >= FEWEST_VIEWS else None
        return own_points(scene) if found is None else found

    def has_normals_of(self, scene: "Scene") -> bool:
        """Whether :meth:`with_normals_in` may find a hull, whose normals are nearly right from the first step."""
        from ringlight.data.surface import is_cut_out

        return self.points > 0 and len(scene.train) >= FEWEST_VIEWS and is_cut_out(scene)
