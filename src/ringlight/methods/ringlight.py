"""ringlight: looks at the scene and chooses how to light it: by a shared basis of harmonics, as a mirror, or as 3dgs.

What it leaves open is decided here and in ``reflection_trial.py``, once, when a run starts: the run, its files and its
report are of the method that was chosen.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, ClassVar, Literal

from ringlight.errors import RecipeError
from ringlight.methods.ringlight_basis import RingLightBasisRecipe
from ringlight.methods.ringlight_mirror import RingLightMirrorRecipe
from ringlight.methods.three_dgs import ThreeDGSRecipe

if TYPE_CHECKING:
    from jaxtyping import Float
    from torch import Tensor

    from ringlight.core.scene import Scene
    from ringlight.fit.train import Training
    from ringlight.methods.recipe import Recipe
    from ringlight.models.contract import Model
    from ringlight.rasterize.contract import Rasterizer


Shading = Literal["basis", "mirror", "harmonics"]
Chosen = RingLightBasisRecipe | RingLightMirrorRecipe | ThreeDGSRecipe

SHADINGS: dict[Shading, tuple[str, type[Chosen]]] = {
    "basis": ("ringlight-basis", RingLightBasisRecipe),
    "mirror": ("ringlight-mirror", RingLightMirrorRecipe),
    "harmonics": ("3dgs", ThreeDGSRecipe),
}
"""Methods to choose from, whose recipes have what a ``RingLightRecipe`` sets."""

SUITS: dict[Shading, str] = {
    "basis": "for surfaces that do not mirror",
    "mirror": "for surfaces that mirror what is around",
    "harmonics": "the plain one",
}
"""Words for a person who knows photographs and no method."""


@dataclass(frozen=True)
class GrowthBound:
    """Adaptive density control is that of the chosen method, but for its bound."""

    max_gaussians: int = 0
    """Density control ends with no more than this many, unless it began with more. 0: as many as a training photograph
    has pixels, 0.85 of them where Gaussians have weights of a shared basis; where pixels of a subject that is cut out
    are lit, one for every seven, but at least 200 for each photograph, between 10,000 and 20,000, if there are as
    many pixels."""

    def __post_init__(self) -> None:
        if self.max_gaussians < 0:
            raise RecipeError(f"densify.max_gaussians is {self.max_gaussians}; give at least 0")


@dataclass(frozen=True)
class RingLightRecipe:
    """RingLight: ringlight-basis or ringlight-mirror, whichever suits the scene, or 3dgs where neither does."""

    packings: ClassVar[tuple[tuple[str, str], ...]] = ()
    steps: int = 30_000
    """Training steps, one photograph each."""
    shading: Literal["auto", "basis", "mirror", "harmonics"] = "auto"
    """basis: each Gaussian is lit, by harmonics mixed of a few that all share; ringlight-basis. mirror: each pixel is
    lit, by what its surface reflects; ringlight-mirror. harmonics: 3dgs. auto: basis or mirror by a short trial where
    masks or an even background cut the subject out of the photographs, so that a surface can be carved; elsewhere
    mirror from points on a surface, and basis without such points; harmonics for few photographs, or where these show
    no subject."""
    antialiased: bool | None = None
    """Rasterize with the opacity compensation of Mip-Splatting; by default only as a mirror."""
    visible_only: bool = False
    """Step only the Gaussians that the photograph shows; the others keep value and momentum."""
    densify: GrowthBound = field(default_factory=GrowthBound)
    """The bound on the number of Gaussians, whichever method is chosen."""

    def settled(self, scene: "Scene", rasterize: "Rasterizer", seed: int) -> "tuple[Chosen, str | None]":
        """The recipe of the chosen method with these settings, and why it was chosen, unless the user did."""
        if self.shading != "auto":
            return self.chosen(self.shading).settled(scene, rasterize, seed)
        from ringlight.methods.reflection_trial import chosen_shading

        shading, reason = chosen_shading(scene, rasterize, seed, self.steps)
        settled, _ = self.chosen(shading).settled(scene, rasterize, seed)
        return settled, f"method: {SHADINGS[shading][0]}, {SUITS[shading]} ({reason})"

    def may_settle_on(self, other: "Recipe") -> bool:
        """Whether it is a method that this one chooses, or may choose, their bounds aside."""
        shadings = SHADINGS if self.shading == "auto" else (self.shading,)
        return any(self.chosen(shading).may_settle_on(other) for shading in shadings)

    def chosen(self, shading: Shading) -> Chosen:
        """The recipe of the method that lights so, with these settings."""
        chosen: Chosen = SHADINGS[shading][1]()
        chosen = replace(chosen, steps=self.steps, visible_only=self.visible_only).ending_with(self.most)
        return chosen if self.antialiased is None else replace(chosen, antialiased=self.antialiased)

    def build(self, scene: "Scene", rasterize: "Rasterizer", seed: int) -> "Training":
        return self.settled(scene, rasterize, seed)[0].build(scene, rasterize, seed)

    def model(self, box: "Float[Tensor, '2 3']", rasterize: "Rasterizer") -> "Model":
        """Raises RecipeError: no file holds this recipe, but the one that it settles on."""
        raise RecipeError("ringlight chooses a method by the scene; a model is of that method")

    def as_stored(self, shapes: Mapping[str, tuple[int, ...]]) -> "RingLightRecipe":
        """Itself: no file holds it."""
        return self

    @property
    def start(self) -> None:
        """Left to the method that it chooses."""

    @property
    def random_points(self) -> int:
        """As the photographs' size says, whichever method is chosen."""
        return 0

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

    def without_effect(self) -> dict[str, str]:
        """All have one."""
        return {}
