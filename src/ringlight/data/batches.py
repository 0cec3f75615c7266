"""Which photograph each training step looks at."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.randomness import generator
from ringlight.core.scene import Scene, View
from ringlight.data.dropout import Dropout, LeftOut
from ringlight.data.shrunk import shrunk


@dataclass(frozen=True)
class ImageBatch:
    """One photograph and the background that it is composited over; ``index`` counts training views."""

    index: int
    view: View
    background: Float[Tensor, "3"]
    has_fixed_background: bool = True
    """Whether every step lays this photograph over the same one."""
    left_out: LeftOut | None = None
    """Which Gaussians its prediction goes without."""
    photographed: bool = True
    """Whether the photograph was taken by the view's camera."""

    @property
    def label(self) -> str:
        """What a message calls it."""
        return f"view {self.view.name}"

    @property
    def camera(self) -> Camera:
        """The camera of the photograph."""
        return self.view.camera


COARSE = (4, 2)
"""Photographs begin at a quarter of their size, then half (3DGS, section 7.1)."""

SMALLEST_COARSE = 50
"""Pixels. Photographs are never shrunk to less, where the loss's window of 11 would see little but borders."""


class ImageBatches:
    """Every view once an epoch, in an order drawn anew each epoch; a pure function of (seed, step).

    The first ``coarse_steps`` steps see photographs at a quarter of their size, as many again at half.
    """

    def __init__(self, scene: Scene, seed: int, coarse_steps: int = 0, dropout: Dropout | None = None):
        self.scene, self.seed, self.coarse_steps, self.dropout = scene, seed, coarse_steps, dropout
        self._shrunk: dict[tuple[int, int], View] = {}
        self._epoch, self._order = -1, list[int]()

    def at(self, step: int) -> ImageBatch:
        """The batch of ``step`` (1 is the first)."""
        epoch, position = divmod(step - 1, len(self.scene.train))
        if epoch != self._epoch:
            draw = generator(self.seed, epoch, "order of views")
            self._epoch, self._order = epoch, torch.randperm(len(self.scene.train), generator=draw).tolist()
        index = self._order[position]
        left_out = self.dropout.at(self.seed, step) if self.dropout else None
        fixed = self.scene.background != "random"
        return ImageBatch(index, self._view(index, step), self._background(step), fixed, left_out)

    def _view(self, index: int, step: int) -> View:
        stage, view = (step - 1) // self.coarse_steps if self.coarse_steps else len(COARSE), self.scene.train[index]
        if stage >= len(COARSE) or min(view.camera.width, view.camera.height) < SMALLEST_COARSE * COARSE[stage]:
            return view
        return self._shrunk.setdefault((index, stage), shrunk(view, COARSE[stage]))

    def _background(self, step: int) -> Float[Tensor, "3"]:
        if self.scene.background != "random":
            return self.scene.background_color
        return torch.rand(3, generator=generator(self.seed, step, "background"))
