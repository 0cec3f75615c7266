"""Deferred reflection of a distant environment (3DGS-DR, Ye et al. 2024, section 4.1).

Base colour, normal and strength are blended; then every pixel looks up one cubemap in the direction that its blended
normal reflects: c = (1 - R) c_base + R env(reflected). The light has no mips, and it lies at an infinite distance.
"""

from collections.abc import Mapping

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ringlight.core.camera import Camera
from ringlight.core.directions import reflect, view_directions
from ringlight.core.gradients import SHADER, Gradients
from ringlight.core.kernel_limits import ENVIRONMENT_MAX_SIDE
from ringlight.core.randomness import generator
from ringlight.core.rendering import Channels, ImageGradients, Shaded
from ringlight.core.want import Want
from ringlight.errors import RecipeError
from ringlight.fields.cubemap import FACES, bordered, looked_up
from ringlight.shade.by_torch import shaded_by_torch
from ringlight.shade.covered import covered_pixels
from ringlight.shade.environment_kernel import (
    environment_color,
    environment_gradients,
    environment_job,
    kernel_takes,
)
from ringlight.shade.passthrough import unchanged

FIRST_RANGE = 5.0
"""Logits of the texels are drawn from so far on both sides of zero in 3DGS-DR: nearly black to nearly white, so that a
normal has something to go by from the first step on."""


class EnvironmentShader(nn.Module):
    """color = (1 - reflection) rgb + reflection environment(reflected view), at pixels that are opaque enough.

    Channels: "rgb" 3, over the background, "normal" 3, world, blended unit vectors, and "reflection" 1, a blended
    strength in [0, 1]. Parameter: ``texels`` [6 S S 3], logits of the environment's colours, see ``fields/cubemap.py``.
    They are drawn from ``first_range`` on both sides of zero. Buffer: ``lit``, False during the warm-up, when "rgb" is
    the colour.
    """

    lit: Tensor
    adds_light = True

    def __init__(self, side: int, seed: int = 0, first_range: float = FIRST_RANGE):
        super().__init__()
        if not 1 <= side <= ENVIRONMENT_MAX_SIDE:
            raise RecipeError(
                f"a face of the environment has {side} texels on a side; give 1 to {ENVIRONMENT_MAX_SIDE}"
            )
        drawn = torch.rand(FACES, side, side, 3, generator=generator(seed, 0, "environment"))
        self.texels = nn.Parameter((2 * drawn - 1) * first_range)
        # Python reads it, also of a model that is an outline on torch's meta device.
        self.register_buffer("lit", torch.tensor(True, device="cpu"))

    @property
    def needs(self) -> Mapping[str, int]:
        """Base colours alone during the warm-up."""
        return {"rgb": 3, "normal": 3, "reflection": 1} if self.lit else {"rgb": 3}

    def tiles(self, camera: Camera, background: Float[Tensor, "3"], want: Want) -> None:
        """None: whole pictures are shaded."""

    def shade(
        self,
        image: Float[Tensor, "H W C"],
        alpha: Float[Tensor, "H W 1"],
        camera: Camera,
        background: Float[Tensor, "3"],
        want: Want,
        shaded: Float[Tensor, "H W 3"] | None = None,
    ) -> Shaded:
        """Differentiable in all channels and texels; alpha only says which pixels are shaded."""
        if not self.lit:
            return Shaded(image, unchanged)

        if kernel_takes(image, alpha, self.texels):
            return self._shaded_by_kernel(image, alpha, camera, want)

        def color(image: Tensor, alpha: Tensor) -> Tensor:
            buffers = dict(zip(self.needs, image.split((3, 3, 1), -1), strict=True))
            return self.reference(buffers | {"alpha": alpha}, camera, background)

        return shaded_by_torch(color, image, alpha, {SHADER + "texels": self.texels}, want)

    @torch.no_grad()
    def _shaded_by_kernel(
        self, image: Float[Tensor, "H W 7"], alpha: Float[Tensor, "H W 1"], camera: Camera, want: Want
    ) -> Shaded:
        job = environment_job(self.texels, image, alpha, camera)
        color = environment_color(job)
        if want is not Want.GRADIENTS:
            return Shaded(color)

        @torch.no_grad()
        def backward(grad_color: Tensor, into: Gradients) -> ImageGradients:
            grad_image, grad_texels = environment_gradients(job, grad_color)
            into.add(SHADER + "texels", grad_texels)
            return grad_image, None

        return Shaded(color, backward)

    def reference(self, buffers: Channels, camera: Camera, background: Float[Tensor, "3"]) -> Float[Tensor, "H W 3"]:
        """What the kernel computes, in torch and in any precision."""
        surfaces = {name: buffers[name] for name in ("rgb", "normal", "alpha")}
        surfaces["alpha"] = surfaces["alpha"].detach()
        pixels = covered_pixels(surfaces, camera, background, depth_gradient=False)
        rgb, strength = (buffers[name].flatten(0, 1)[pixels.index] for name in ("rgb", "reflection"))
        seen = self.seen(reflect(pixels.directions, pixels.normals))
        whole = buffers["rgb"].flatten(0, 1).index_add(0, pixels.index, strength * (seen - rgb))
        return whole.view_as(buffers["rgb"])

    def seen(self, directions: Float[Tensor, "P 3"]) -> Float[Tensor, "P 3"]:
        """The environment's colour in [0, 1] in these directions."""
        return looked_up(bordered(self.texels.sigmoid()), directions)

    def features(self, buffers: Channels, camera: Camera, background: Float[Tensor, "3"]) -> None:
        """None: no network stands behind the environment."""

    def emitted(self, channels: Channels, points: Float[Tensor, "N 3"], camera: Camera) -> Float[Tensor, "N 3"]:
        """Each Gaussian's own surface shaded: what harmonics can be fitted to."""
        base = channels["rgb"]
        if not self.lit:
            return base
        directions = view_directions(points, camera.position.to(points))
        seen = self.seen(reflect(directions, channels["normal"]))
        return base + channels["reflection"] * (seen - base)
