"""The socket: blended channels in, colour out, per pixel."""

from typing import Protocol, runtime_checkable

from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.rendering import Channels


@runtime_checkable
class Shader(Protocol):
    """May be an ``nn.Module`` with shared parameters."""

    def shade(self, buffers: Channels, camera: Camera) -> Float[Tensor, "H W 3"]:
        """Colour of each pixel from the blended channels, [H W c] by name."""
        ...
