"""Views that nobody photographed: training cameras moved a little, without a turn.

After the pseudo views of LightGaussian (Fan et al. 2023, section 3.3), for who learns from another model's pictures.
"""

from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.randomness import generator
from ringlight.data.batches import ImageBatch, ImageBatches

PHOTOGRAPHED = 3
"""One in so many steps keeps the photograph's own camera; the other two of three are moved."""


class MovedCameras:
    """The batches of ``photographs``; after step ``first``, to step ``last``, two cameras of three are moved.

    The offset is normal, with this ``deviation`` along each axis in world units, and depends on (seed, step) alone. A
    moved batch keeps its photograph, which is of another view, and says so: it is for a loss that looks at none then.
    """

    def __init__(self, photographs: ImageBatches, first: int, last: int, deviation: float, seed: int):
        self.photographs, self.first, self.last = photographs, first, last
        self.deviation, self.seed = deviation, seed

    def at(self, step: int) -> ImageBatch:
        """The batch of ``step`` (1 is the first)."""
        batch = self.photographs.at(step)
        if not self.first < step <= self.last or step % PHOTOGRAPHED == 0:
            return batch
        offset = self.deviation * torch.randn(3, generator=generator(self.seed, step, "moved camera"))
        view = replace(batch.view, name=f"{batch.view.name}, moved", camera=moved(batch.camera, offset))
        return replace(batch, view=view, photographed=False)


def moved(camera: Camera, offset: Float[Tensor, "3"]) -> Camera:
    """The camera at another place, ``offset`` in world units, with the same axes."""
    matrix = camera.world_to_camera.clone()
    matrix[:3, 3] -= matrix[:3, :3] @ offset
    return replace(camera, world_to_camera=matrix)
