"""Forward models are shaded before blending: nothing is left to do per pixel."""

from collections.abc import Mapping

from jaxtyping import Float
from torch import Tensor, nn

from ringlight.core.camera import Camera
from ringlight.core.gradients import Gradients
from ringlight.core.rendering import Channels, ImageGradients, Shaded
from ringlight.core.want import Want


class PassThrough(nn.Module):
    """The blended "rgb" channel is the colour."""

    adds_light = False
    needs: Mapping[str, int] = {"rgb": 3}

    def tiles(self, camera: Camera, background: Float[Tensor, "3"], want: Want) -> None:
        """None: there is nothing to shade."""

    def shade(
        self,
        image: Float[Tensor, "H W 3"],
        alpha: Float[Tensor, "H W 1"],
        camera: Camera,
        background: Float[Tensor, "3"],
        want: Want,
        shaded: Float[Tensor, "H W 3"] | None = None,
    ) -> Shaded:
        return Shaded(image, unchanged)

    def features(self, buffers: Channels, camera: Camera, background: Float[Tensor, "3"]) -> None:
        """None: there is no light here."""

    def emitted(self, channels: Channels, points: Float[Tensor, "N 3"], camera: Camera) -> Float[Tensor, "N 3"]:
        return channels["rgb"]


def unchanged(grad_color: Float[Tensor, "H W 3"], into: Gradients) -> ImageGradients:
    """The way back of a colour that is the blended one."""
    return grad_color, None
