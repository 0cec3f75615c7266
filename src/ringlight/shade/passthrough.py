"""Forward models are shaded before blending: nothing is left to do per pixel."""

from jaxtyping import Float
from torch import Tensor, nn

from ringlight.core.camera import Camera
from ringlight.core.rendering import Channels


class PassThrough(nn.Module):
    """The blended "rgb" channel is the colour."""

    passes_through = True
    """Nothing to differentiate: what a loop without autograd asks before it leaves the shader out."""

    adds_light = False

    def shade(self, buffers: Channels, camera: Camera, background: Float[Tensor, "3"]) -> Float[Tensor, "H W 3"]:
        return buffers["rgb"]

    def emitted(self, channels: Channels, points: Float[Tensor, "N 3"], camera: Camera) -> Float[Tensor, "N 3"]:
        return channels["rgb"]
