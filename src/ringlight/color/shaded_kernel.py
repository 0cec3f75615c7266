"""The kernels of shaded Gaussians: blurred maps of their environment as one sparse product, then each one's shading."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight import _kernels
from ringlight.color.reflective_harmonics import SHORTEST_QUATERNION
from ringlight.color.specular_table import specular_table
from ringlight.color.split_sum import SMOOTHEST, SplitSumLight
from ringlight.core.camera import Camera
from ringlight.core.directions import SMALLEST_LENGTH
from ringlight.core.kernel_limits import SHADED_MAX_LEVELS
from ringlight.fields.prefilter import QUAD

NOT_MOVED = "log_scales"
"""The column that is read and has no gradient: which axis is the shortest."""


@lru_cache(maxsize=1)
def _shares() -> Float[Tensor, "C R 2"]:
    """F0 and F1 side by side."""
    return specular_table().permute(2, 1, 0).contiguous()


def kernel_takes(light: SplitSumLight) -> bool:
    """Whether the light has no more maps than the kernels count."""
    return len(light.roughness) <= SHADED_MAX_LEVELS


class LightJob:
    """The blurred maps of one view, [R 4], and the way back to the environment's logits."""

    def __init__(self, light: SplitSumLight):
        self.light, self.colors = light, light.texels.detach().sigmoid()
        there, self._back = light.filters()
        self.maps = there.of_quads(torch.nn.functional.pad(light.mips(self.colors), (0, QUAD - 3)))

    def of_texels(self, of_maps: Float[Tensor, "R 4"]) -> Float[Tensor, "6 S S 3"]:
        """dL/d(logits) from dL/d(maps)."""
        of_colors = self.light.mips_gradient(self._back.of_quads(of_maps)[:, :3])
        return of_colors * self.colors * (1 - self.colors)


@dataclass(frozen=True)
class ShadedJob:
    """One view of shaded Gaussians: their channels, and the gradients of what these are made of."""

    columns: Mapping[str, Tensor]
    light: LightJob
    kernel: _kernels.ShadedJob

    @staticmethod
    def of(columns: Mapping[str, Tensor], light: SplitSumLight, camera: Camera, ambient: bool) -> "ShadedJob":
        """``columns`` by the names of the kernel's arguments; "bases" are the harmonics' colours."""
        job = LightJob(light)
        kernel = _kernels.ShadedJob(
            **columns,
            camera=camera.native,
            smallest_quaternion=SHORTEST_QUATERNION,
            smallest_length=SMALLEST_LENGTH,
            smoothest=SMOOTHEST,
            ambient=ambient,
            sides=torch.tensor(light.sides),
            level_roughness=torch.tensor(light.roughness),
            maps=job.maps,
            shares=_shares(),
        )
        return ShadedJob(columns, job, kernel)

    def channels(self, width: int) -> Float[Tensor, "N width"]:
        """The colour; with a ``width`` of 7 the normal and the depth too."""
        means = self.columns["means"]
        channels = means.new_empty(len(means), width)
        _kernels.shaded_forward(self.kernel, channels)
        return channels

    def gradients(self, of_channels: Float[Tensor, "N width"]) -> tuple[dict[str, Tensor], Float[Tensor, "6 S S 3"]]:
        """By columns, under the kernel's names, and by the light's logits."""
        found = {name: torch.empty_like(column) for name, column in self.columns.items() if name != NOT_MOVED}
        of_maps = torch.empty_like(self.light.maps)
        outputs = {f"of_{name}": gradient for name, gradient in found.items()}
        _kernels.shaded_backward(self.kernel, of_channels.contiguous(), of_maps=of_maps, **outputs)
        return found, self.light.of_texels(of_maps)
