"""ringlight: looks at the scene and chooses how to light it, by a shared basis of harmonics or as a mirror.

What it leaves open is decided here and in ``reflection_trial.py``, once, when a run starts: the run, its files and its
report are of the method that was chosen.
"""

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

from ringlight.errors import RecipeError
from ringlight.methods.ringlight_basis import RingLightBasisRecipe
from ringlight.methods.ringlight_mirror import RingLightMirrorRecipe

if TYPE_CHECKING:
    from jaxtyping import Float
    from torch import Tensor

    from ringlight.core.scene import Scene
    from ringlight.fit.train import Training
    from ringlight.models.contract import Model
    from ringlight.rasterize.contract import Rasterizer


@dataclass(frozen=True)
class GrowthBound:
    """Adaptive density control is that of the chosen method, but for its bound."""

    max_gaussians: int = 0
    """Density control ends with no more than this many, unless it began with more. 0: as many as a training photograph
    has pixels; where pixels of a subject that is cut out are lit, one for every seven, or 10,000 if there are as many
    pixels."""

    def __post_init__(self) -> None:
        if self.max_gaussians < 0:
            raise RecipeError(f"densify.max_gaussians is {self.max_gaussians}; give at least 0")


@dataclass(frozen=True)
class RingLightRecipe:
    """RingLight: ringlight-basis or ringlight-mirror, whichever suits the scene."""

    steps: int = 30_000
    """Training steps, one photograph each."""
    shading: Literal["auto", "forward", "deferred"] = "auto"
    """forward lights each Gaussian: ringlight-basis. deferred lights each pixel of the surface that they blend to:
    ringlight-mirror. auto: decided by a short trial where masks or an even background cut the subject out of the
    photographs, so that a surface can be carved; elsewhere deferred, from points on a surface, and forward without such
    points or with few photographs."""
    antialiased: bool | None = None
    """Rasterize with the opacity compensation of Mip-Splatting; by default only with deferred shading."""
    visible_only: bool = False
    """Step only the Gaussians that the photograph shows; the others keep value and momentum."""
    densify: GrowthBound = field(default_factory=GrowthBound)
    """The bound on the number of Gaussians, whichever method is chosen."""

    def settled(
        self, scene: "Scene", rasterize: "Rasterizer", seed: int
    ) -> "tuple[RingLightBasisRecipe | RingLightMirrorRecipe, str | None]":
        """The recipe of the chosen method with these settings, and why it was chosen, unless the user did."""
        shading, why = self.shading, None
        if shading == "auto":
            from ringlight.methods.reflection_trial import chosen_shading

            shading, reason = chosen_shading(scene, rasterize, seed, self.steps)
            method = "ringlight-basis" if shading == "forward" else "ringlight-mirror"
            why = f"shading: {shading}, as {method} ({reason})"
        chosen: RingLightBasisRecipe | RingLightMirrorRecipe
        chosen = RingLightBasisRecipe() if shading == "forward" else RingLightMirrorRecipe()
        chosen = replace(chosen, steps=self.steps, visible_only=self.visible_only).ending_with(self.most)
        if self.antialiased is not None:
            chosen = replace(chosen, antialiased=self.antialiased)
        return chosen.at_length(), why

    def build(self, scene: "Scene", rasterize: "Rasterizer", seed: int) -> "Training":
        return self.settled(scene, rasterize, seed)[0].build(scene, rasterize, seed)

    def model(self, box: "Float[Tensor, '2 3']", rasterize: "Rasterizer") -> "Model":
        """Raises RecipeError: no file holds this recipe, but the one that it settles on."""
        raise RecipeError("ringlight chooses a method by the scene; a model is of that method")

    @property
    def most(self) -> int | None:
        """How many Gaussians the user lets it end with, whichever method is chosen."""
        return self.densify.max_gaussians or None

    def ending_with(self, most: int | None, dropping: bool = True) -> "RingLightRecipe":
        """The same with this for ``most``; whether some are dropped is the chosen method's."""
        return replace(self, densify=GrowthBound(most or 0))

    def never_above(self, most: int) -> "RingLightRecipe":
        """The same with ``most`` at the end; it is the chosen method's recipe that is asked."""
        return self.ending_with(most)
