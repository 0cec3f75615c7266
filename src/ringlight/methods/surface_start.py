"""Where Gaussians start if masks cut the subject out of the photographs: on its visual hull. Torch-free."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ringlight.errors import RecipeError

if TYPE_CHECKING:
    from ringlight.core.scene import PointCloud, Scene

FEWEST_VIEWS = 12
"""Photographs; the hull of fewer is a rough guess."""


@dataclass(frozen=True)
class SurfaceStart:
    """Gaussians drawn from the visual hull of the photographs' masks, as discs that lie in it."""

    points: int = 0
    """So many; 0 starts from the scene's points, and so do scenes without masks or with fewer than 12 photographs."""
    opacity: float = 0.5
    """Of these Gaussians at the start."""

    def __post_init__(self) -> None:
        if self.points < 0:
            raise RecipeError(f"start.points is {self.points}; give 0 (the scene's points) or more")
        if not 0 < self.opacity < 1:
            raise RecipeError(f"start.opacity is {self.opacity:g}; an opacity lies between 0 and 1")

    def points_in(self, scene: "Scene", seed: int) -> "PointCloud":
        """Points of the hull, or else the scene's own. The hull takes some seconds."""
        from ringlight.data.hull import masks_of
        from ringlight.data.surface import points_on_hull

        if not self.points or len(scene.train) < FEWEST_VIEWS:
            return scene.points
        return points_on_hull(masks_of(scene.train), scene, self.points, seed) or scene.points
