"""The socket: blended channels in, colour out, per pixel."""

from typing import TYPE_CHECKING, Protocol, runtime_checkable

from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.rendering import Channels

if TYPE_CHECKING:
    from ringlight import _kernels


@runtime_checkable
class Shader(Protocol):
    """May be an ``nn.Module`` with shared parameters."""

    adds_light: bool
    """Whether it shows anything but the blended "rgb": then no export of the Gaussians' colours alone is exact."""

    def shade(self, buffers: Channels, camera: Camera, background: Float[Tensor, "3"]) -> Float[Tensor, "H W 3"]:
        """Colour of each pixel from the blended channels, [H W c] by name; memory may be planar.

        "rgb" lies over ``background``. All others are sums over the Gaussians in front, so that a pixel's mean is the
        sum over "alpha" [H W 1], which is always there.
        """
        ...

    def emitted(self, channels: Channels, points: Float[Tensor, "N 3"], camera: Camera) -> Float[Tensor, "N 3"]:
        """What single Gaussians at ``points`` would show, each alone and opaque, from their channels [N c]."""
        ...


@runtime_checkable
class TileShader(Protocol):
    """A shader that may also work inside the compiled rasterizer; a shader that can has this method."""

    def tiles(self, camera: Camera, background: Float[Tensor, "3"]) -> "_kernels.PictureShader | None":
        """What shades a picture's tiles as they are blended; None where that cannot be."""
        ...


@runtime_checkable
class DirectShader(Protocol):
    """Shading and its gradient without autograd; a shader that can has a method ``direct()`` that makes one or None."""

    def draw(self, buffers: Channels, camera: Camera, background: Float[Tensor, "3"]) -> Float[Tensor, "H W 3"]:
        """As :meth:`Shader.shade`."""
        ...

    def tiles(self, camera: Camera, background: Float[Tensor, "3"]) -> "_kernels.PictureShader | None":
        """What gives the bits of :meth:`draw` while a picture is blended; None where there is no use for it."""
        ...

    def keep(self, buffers: Channels) -> None:
        """The blended channels [H W c] and "alpha" [H W 1] of the picture that :meth:`tiles` shaded, as :meth:`draw`
        would have got them; to be called before :meth:`differentiate`."""
        ...

    def differentiate(
        self, by_color: Float[Tensor, "H W 3"]
    ) -> tuple[Float[Tensor, "H W C"], Float[Tensor, "H W 1"] | None, dict[str, Tensor]]:
        """Gradients for the last picture drawn: of the blended channels side by side, as the colour model has them, of
        "alpha", and of the shader's own parameters by name. None for alpha, and no parameters, where they had no part.
        """
        ...
