"""Which photograph each training step looks at."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.randomness import generator
from ringlight.core.scene import Scene, View


@dataclass(frozen=True)
class ImageBatch:
    """One whole photograph and the background that it is composited over; ``index`` counts training views."""

    index: int
    view: View
    background: Float[Tensor, "3"]

    @property
    def camera(self) -> Camera:
        """The camera of the photograph."""
        return self.view.camera


class ImageBatches:
    """Every view once an epoch, in an order drawn anew each epoch; a pure function of (seed, step)."""

    def __init__(self, scene: Scene, seed: int):
        self.scene, self.seed = scene, seed
        self._epoch, self._order = -1, list[int]()

    def at(self, step: int) -> ImageBatch:
        """The batch of ``step`` (1 is the first)."""
        epoch, position = divmod(step - 1, len(self.scene.train))
        if epoch != self._epoch:
            draw = generator(self.seed, epoch, "order of views")
            self._epoch, self._order = epoch, torch.randperm(len(self.scene.train), generator=draw).tolist()
        index = self._order[position]
        return ImageBatch(index, self.scene.train[index], self._background(step))

    def _background(self, step: int) -> Float[Tensor, "3"]:
        if self.scene.background != "random":
            return self.scene.background_color
        return torch.rand(3, generator=generator(self.seed, step, "background"))
