"""The socket: blended channels in, colour out, per pixel."""

from collections.abc import Mapping
from typing import Protocol, runtime_checkable

from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.light_features import LightFeatures
from ringlight.core.rendering import Channels, Shaded, TileShading
from ringlight.core.want import Want


@runtime_checkable
class Shader(Protocol):
    """An ``nn.Module`` with shared parameters, named ``shader.…``."""

    adds_light: bool
    """Whether it shows anything but the blended "rgb": then no export of the Gaussians' colours alone is exact."""

    @property
    def needs(self) -> Mapping[str, int]:
        """The channels that it reads now, by name and width, in the order in which ``shade`` gets them. All of them
        until training switches something off."""
        ...

    def tiles(self, camera: Camera, background: Float[Tensor, "3"], want: Want) -> TileShading | None:
        """A hint for the compiled rasterizer: what shades tiles as soon as they are blended, from exactly the channels
        in ``needs``. None where there is no such thing."""
        ...

    def shade(
        self,
        image: Float[Tensor, "H W C"],
        alpha: Float[Tensor, "H W 1"],
        camera: Camera,
        background: Float[Tensor, "3"],
        want: Want,
        shaded: Float[Tensor, "H W 3"] | None = None,
    ) -> Shaded:
        """Colour of each pixel from the channels in ``needs``, side by side in that order; memory may be planar.

        "rgb" lies over ``background``. All others are sums over the Gaussians in front, so that a pixel's mean is the
        sum over ``alpha``. ``shaded`` is the colour already, where a rasterizer took the hint of :meth:`tiles`.
        """
        ...

    def features(self, buffers: Channels, camera: Camera, background: Float[Tensor, "3"]) -> LightFeatures | None:
        """What its neural light gives to pixels; None without one, or before it is on.

        ``buffers`` are the blended channels in ``needs`` and "alpha", [H W c] by name. Asked only of one that adds
        light.
        """
        ...

    def emitted(self, channels: Channels, points: Float[Tensor, "N 3"], camera: Camera) -> Float[Tensor, "N 3"]:
        """What single Gaussians at ``points`` would show, each alone and opaque, from their channels [N c] by name."""
        ...
