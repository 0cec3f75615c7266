"""The socket: what each Gaussian emits towards a camera."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from jaxtyping import Bool, Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import Gradient
from ringlight.core.rendering import Channels
from ringlight.core.scene import PointCloud

if TYPE_CHECKING:
    from ringlight import _kernels


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


@dataclass(frozen=True)
class LateColors:
    """The channel "rgb", worked out row by row when a rasterizer first needs it.

    ``kernel`` is what the compiled rasterizer asks, for the bits of ``channels``; ``checked`` must be finite, for the
    kernel makes colours of it; ``opacity_factor`` is that of ``Channels``. A colour model that can may have a method
    ``late(gaussians, camera)`` that returns one of these, or None.
    """

    checked: Float[Tensor, "N 3"]
    kernel: "_kernels.LazyColors"
    opacity_factor: Float[Tensor, "N"] | None


@runtime_checkable
class DirectColor(Protocol):
    """What a colour model emits, and its gradient, without autograd.

    A colour model that can may have a method ``direct()`` that returns one of these, or None.
    """

    widths: Mapping[str, int]
    """The channels of the last view drawn, by name, in order: "rgb" comes first."""

    opacity_factor: Float[Tensor, "N"] | None
    """Of the last view drawn, see ``Channels``; not among ``widths``."""

    late: "_kernels.LazyColors | None"
    """Of the last view drawn: what the rasterizer is to ask for "rgb", or None where ``draw`` returned it."""

    def draw(self, gaussians: Gaussians, camera: Camera, may_be_late: bool = False) -> Float[Tensor, "N C"]:
        """All channels side by side; with ``late`` colours what these are made of, which must be finite."""
        ...

    def differentiate(self, by_channels: Float[Tensor, "N C"], by_geometry: dict[str, Tensor]) -> dict[str, Gradient]:
        """Gradients for the last view drawn: of the colour's columns by name, of shared parameters by "color.name".

        ``by_geometry`` are the geometry's, by column: what the colour's positions add goes there, and the gradient of
        ``opacity_factor``, under that name, is taken out.
        """
        ...
