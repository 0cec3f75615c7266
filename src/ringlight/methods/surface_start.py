"""Where Gaussians start if masks cut the subject out of the photographs: on or in its visual hull. Torch-free."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ringlight.errors import RecipeError

if TYPE_CHECKING:
    from ringlight.core.scene import PointCloud, Scene

FEWEST_VIEWS = 12
"""Photographs; the hull of fewer is a rough guess."""

FEWEST_ON_SURFACE = 50
"""Photographs. Of fewer, Gaussians start anywhere in the hull, for where it is too wide those on its surface hide what
lies within: 1.9 dB on lego_400 with 24 photographs. With 60 it is 0.3 dB the other way
(docs/experiments/few-photographs.md)."""

FIRST_GAUSSIANS = 20_000
"""On the hull; half of them cost 0.2 dB on chair_400, twice of them only add Gaussians."""


@dataclass(frozen=True)
class SurfaceStart:
    """Gaussians drawn from the visual hull of the photographs' masks: discs that lie in its surface, or with fewer than
    50 photographs faint balls anywhere in it."""

    points: int = FIRST_GAUSSIANS
    """So many; 0 starts from the scene's points, and so do scenes without masks or with fewer than 12 photographs."""
    opacity: float = 0.5
    """Of discs at the start; balls have 0.1."""

    def __post_init__(self) -> None:
        if self.points < 0:
            raise RecipeError(f"start.points is {self.points}; give 0 (the scene's points) or more")
        if not 0 < self.opacity < 1:
            raise RecipeError(f"start.opacity is {self.opacity:g}; an opacity lies between 0 and 1")

    def points_in(self, scene: "Scene", seed: int) -> "PointCloud":
        """Points of the hull, or else the scene's own. The hull takes some seconds."""
        from ringlight.data.hull import masks_of
        from ringlight.data.surface import points_in_hull, points_on_hull

        if not self.points or len(scene.train) < FEWEST_VIEWS:
            return scene.points
        drawn = points_on_hull if len(scene.train) >= FEWEST_ON_SURFACE else points_in_hull
        return drawn(masks_of(scene.train), scene, self.points, seed) or scene.points

    def with_normals_in(self, scene: "Scene", seed: int) -> "PointCloud":
        """Where methods start that mirror at normals: points of the hull, of masks or of an even background, or else
        the scene's own with normals of the planes through them; without ``points`` the scene's as they are."""
        from ringlight.data.surface import hull_points, own_points

        if not self.points:
            return scene.points
        found = hull_points(scene, self.points, seed) if len(scene.train) >= FEWEST_VIEWS else None
        return own_points(scene) if found is None else found
