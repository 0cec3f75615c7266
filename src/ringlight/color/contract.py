"""The socket: what each Gaussian emits towards a camera."""

from typing import Protocol, runtime_checkable

from jaxtyping import Bool, Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import Gradient
from ringlight.core.rendering import Channels
from ringlight.core.scene import PointCloud


@runtime_checkable
class ColorModel(Protocol):
    """May be an ``nn.Module`` with shared parameters; per-Gaussian parameters live in the table's appearance."""

    training_columns: tuple[str, ...]
    """Columns that rendering does not need once the rows that are not ``wanted`` are gone."""

    def new_columns(self, points: PointCloud) -> dict[str, Tensor]:
        """Per-Gaussian parameters to start from, P rows each."""
        ...

    def channels(self, gaussians: Gaussians, camera: Camera) -> Channels:
        """What gets blended, [N c] by name; "rgb" is required. "opacity_factor" [N 1] is reserved, see Channels."""
        ...

    def layers(self, gaussians: Gaussians, camera: Camera) -> Channels:
        """Parts of the colour worth looking at ("base", "residual", "modulation"), [N c]; may be empty."""
        ...

    def wanted(self, gaussians: Gaussians) -> Bool[Tensor, "N"]:
        """Rows that this colour model still shows; densifiers remove the others."""
        ...


@runtime_checkable
class DirectColor(Protocol):
    """Colours and their gradient without autograd, of a model that emits "rgb" and nothing else.

    A colour model that can may have a method ``direct()`` that returns one of these, or None.
    """

    def draw(self, gaussians: Gaussians, camera: Camera) -> Float[Tensor, "N 3"]:
        """The colours."""
        ...

    def differentiate(self, by_colors: Float[Tensor, "N 3"], by_means: Float[Tensor, "N 3"]) -> dict[str, Gradient]:
        """Gradients of the colour's columns for the last view drawn; adds to ``by_means``."""
        ...
