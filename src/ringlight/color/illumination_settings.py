"""Settings of the 3iGS colour model. Torch-free: recipes hold these."""

from dataclasses import dataclass

from ringlight.core.kernel_limits import PLANES_MAX_CHANNELS, PLANES_MAX_SIDE
from ringlight.errors import RecipeError


@dataclass(frozen=True)
class IlluminationSettings:
    """The illumination field (3iGS, section 3.2), and the network behind it (section 3.3)."""

    side: int = 150
    """Nodes on each axis of the field's planes and lines."""
    components: int = 48
    """Components of each plane and of its line."""
    features: int = 48
    """Features that the field gives to a point, and as many does each Gaussian bring."""
    hidden: int = 128
    """Width of the network's two hidden layers."""

    def __post_init__(self) -> None:
        if not 2 <= self.side <= PLANES_MAX_SIDE:
            raise RecipeError(f"light.side is {self.side}; give 2 to {PLANES_MAX_SIDE}")
        if not 1 <= self.components <= PLANES_MAX_CHANNELS:
            raise RecipeError(f"light.components is {self.components}; give 1 to {PLANES_MAX_CHANNELS}")
        if not 3 <= self.features <= PLANES_MAX_CHANNELS:
            raise RecipeError(f"light.features is {self.features}; give 3 to {PLANES_MAX_CHANNELS}")
        if not 1 <= self.hidden <= MOST_HIDDEN:
            raise RecipeError(f"light.hidden is {self.hidden}; give 1 to {MOST_HIDDEN}")


MOST_HIDDEN = 1024
"""Far wider than any that a step of a second can run."""
