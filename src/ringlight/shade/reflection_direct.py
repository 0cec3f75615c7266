"""The reflection shader without autograd, for training loops: the same kernel, at a fraction of what surrounds it."""

from typing import TYPE_CHECKING

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.rendering import Channels
from ringlight.shade.reflection_kernel import plane_gradients, planes_of, shaded, shading_of

if TYPE_CHECKING:
    from ringlight import _kernels
    from ringlight.shade.reflection import ReflectionShader


class DirectReflection:
    """One view at a time: :meth:`draw`, then :meth:`differentiate`."""

    def __init__(self, shader: "ReflectionShader"):
        self._shader = shader
        names = {id(parameter): name for name, parameter in shader.named_parameters()}
        self._planes: list[Tensor] = []
        self._names = [names[id(parameter)] for parameter in shader.kernel_parameters()]

    def draw(self, buffers: Channels, camera: Camera, background: Float[Tensor, "3"]) -> Float[Tensor, "H W 3"]:
        """See :meth:`ringlight.shade.reflection.ReflectionShader.shade`."""
        if not self._begin(camera, background):
            return buffers["rgb"]
        self.keep(buffers)
        return shaded(self._job, self._planes, self._parameters)

    def tiles(self, camera: Camera, background: Float[Tensor, "3"]) -> "_kernels.PictureShader | None":
        """See :class:`ringlight.shade.contract.DirectShader`."""
        return shading_of(self._job, self._parameters, exact=True) if self._begin(camera, background) else None

    def keep(self, buffers: Channels) -> None:
        """See :class:`ringlight.shade.contract.DirectShader`."""
        self._planes = planes_of(self._job, buffers)

    def _begin(self, camera: Camera, background: Float[Tensor, "3"]) -> bool:
        self._lit, self._planes = bool(self._shader.lit), []  # those of the view before must not go with this one
        if self._lit:
            self._job, self._parameters = self._shader.job(camera, background), self._shader.kernel_parameters()
        return self._lit

    def differentiate(
        self, by_color: Float[Tensor, "H W 3"]
    ) -> tuple[Float[Tensor, "H W C"], Float[Tensor, "H W 1"] | None, dict[str, Tensor]]:
        """See :class:`ringlight.shade.contract.DirectShader`."""
        if not self._lit:
            return by_color, None, {}
        gradients = [torch.empty_like(parameter) for parameter in self._parameters]
        block, by_alpha = plane_gradients(self._job, self._planes, self._parameters, by_color, gradients)
        if not self._job.depth:  # a depth is blended all the same, last of all, and nobody has looked at it
            block = torch.cat([block, torch.zeros_like(by_alpha)])
        return block.permute(1, 2, 0), by_alpha.permute(1, 2, 0), dict(zip(self._names, gradients, strict=True))
