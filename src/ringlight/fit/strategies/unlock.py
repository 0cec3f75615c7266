"""Turn a buffer of the model to a value at a step: raise the SH degree, switch the light field on."""

from collections.abc import Mapping

import torch

from ringlight.core.rendering import Rendering
from ringlight.fit.optimizer import Optimizer
from ringlight.fit.strategies.stateless import Stateless
from ringlight.models.splats import SplatModel


class Unlock(Stateless):
    """Writes ``schedule[step]`` into the buffer when training reaches ``step``; the buffer is saved with the model.

    What is on already, in a model that training started from, is not switched off again.
    """

    def __init__(self, buffer: str, schedule: Mapping[int, int]):
        self.buffer, self.schedule = buffer, dict(schedule)

    def update(self, step: int, model: SplatModel, optimizer: Optimizer, prediction: Rendering) -> None:
        if step in self.schedule:
            with torch.no_grad():
                buffer = model.get_buffer(self.buffer)
                buffer.copy_(torch.maximum(buffer, torch.full_like(buffer, self.schedule[step])))
