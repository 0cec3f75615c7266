"""Settings of the reflection shader; free of torch, so that the command line can print them at once."""

from dataclasses import dataclass, field, replace
from typing import Literal

from ringlight.core.kernel_limits import REFLECTION_MAX_LAYERS
from ringlight.errors import RecipeError
from ringlight.fields.ring_settings import RingSettings

LARGEST = {"hidden": 1024, "features": 64, "latents": 64, "side": 1024, "axis_nodes": 1024}
"""Far beyond what was ever of use. They keep a damaged or hostile model file from asking for all the memory."""

FIRST_LOG_INVERSE_RADII = (-1.5, 0.0)
"""Logarithms of the shells' first inverse radii, in half sides of the scene's box: far around it, and close."""

USUAL_LEVELS = (8, 16, 32, 64)
"""Nodes on each side of maps of what small photographs show."""

FINE_LEVELS, FINE_FROM = (*USUAL_LEVELS, 128), 100_000
"""And for photographs of so many pixels of a subject that is cut out: of 400 x 400 they are worth 0.3 to 0.4 dB on
chrome and nothing on balls, of 200 x 200 nothing, for a quarter of a megabyte (docs/experiments/mirrors.md)."""

NEAR_FIELD = RingSettings(
    rank=8, features=8, head_hidden=64, bands=6, view_bands=4, position_nodes=128, view_nodes=24, core_scale=0.1
)
"""As that of ringlight-ring, with fewer features, since the maps are there as well."""


@dataclass(frozen=True)
class ReflectionSettings:
    """A network shades each pixel once. It sees the blended surface, and features of the reflected direction."""

    hidden: int = 64
    """Width of the network's hidden layers."""
    hidden_layers: int = 2
    """Hidden layers of the network, 1 or 2."""
    levels: tuple[int, ...] | None = None
    """Nodes on each side of the octahedral maps. By default 8 16 32 64, and 128 where photographs have 100,000 pixels
    or more, and masks or an even background cut the subject out."""
    features: int = 4
    """Features at each node of each map."""
    latents: int = 4
    """Values per Gaussian that are blended, and seen by the network besides the base colour: the material."""
    shells: int = 1
    """Spheres on which reflections lie, each with maps of its own."""
    parallax: bool = True
    """Whether reflections lie on spheres whose centre and size are learned; else they lie infinitely far away."""
    axis_nodes: int = 0
    """Nodes on each of three axes. The axes hold factors of the reflecting point that multiply the maps' features:
    together a diagonal tensor ring over point and direction. 0 leaves features of the direction alone."""
    ring: Literal["none", "full", "diagonal"] = "none"
    """Whether the network also sees features of a tensor ring over reflecting point and reflected direction. What is
    reflected from near by depends on both. It runs in torch, so a step takes several times as long."""
    near_field: RingSettings = field(default_factory=lambda: NEAR_FIELD)
    """Sizes of the ring that --shader.ring adds."""
    raw_direction: bool = True
    """Whether the network also sees the viewing direction."""
    gradient_share: float = 1.0
    """Share of the pixels whose shading is differentiated in a step. They are drawn in proportion to their gradients
    and weighted, so that the expectation is the whole gradient (importance sampling). Other devices differentiate
    all."""
    depth_gradient: bool = False
    """Whether the gradient of the reflecting point reaches the blended depth, and so the Gaussians' centres."""

    def __post_init__(self) -> None:
        if self.levels is not None and not self.levels:
            raise RecipeError("shader.levels is empty; give at least one side, such as 32")
        if not 1 <= self.hidden_layers < REFLECTION_MAX_LAYERS:
            raise RecipeError(f"shader.hidden_layers is {self.hidden_layers}; give 1 to {REFLECTION_MAX_LAYERS - 1}")
        for name, value in (("hidden", self.hidden), ("features", self.features), ("latents", self.latents)):
            least = 0 if name == "latents" else 1
            if not least <= value <= LARGEST[name]:
                raise RecipeError(f"shader.{name} is {value}; give {least} to {LARGEST[name]}")
        for side in self.sides:
            if not 2 <= side <= LARGEST["side"]:
                raise RecipeError(f"shader.levels has a side of {side} nodes; give 2 to {LARGEST['side']}")
        self._check_axes()
        if not 0 < self.gradient_share <= 1:
            raise RecipeError(f"shader.gradient_share is {self.gradient_share}; give a share above 0, at most 1")
        most = len(FIRST_LOG_INVERSE_RADII) if self.parallax else 1
        if not 1 <= self.shells <= most:
            without = "" if self.parallax else " without parallax, where all shells would be one"
            raise RecipeError(f"shader.shells is {self.shells}; give 1 to {most}{without}")

    @property
    def sides(self) -> tuple[int, ...]:
        """Nodes on each side of the maps; without photographs that say more, the usual ones."""
        return USUAL_LEVELS if self.levels is None else self.levels

    def for_levels(self, levels: tuple[int, ...]) -> "ReflectionSettings":
        """The same with these where they are left open."""
        return self if self.levels is not None else replace(self, levels=levels)

    def left_to_photographs(self) -> "ReflectionSettings":
        """The same where these maps may be what photographs said, with that left to them."""
        return replace(self, levels=None) if self.levels in (USUAL_LEVELS, FINE_LEVELS) else self

    def _check_axes(self) -> None:
        if self.axis_nodes and not 2 <= self.axis_nodes <= LARGEST["axis_nodes"]:
            most = LARGEST["axis_nodes"]
            raise RecipeError(f"shader.axis_nodes is {self.axis_nodes}; give 0 (no axes), or 2 to {most}")
