"""Remove the Gaussians of least global significance (LightGaussian, Fan et al. 2023, section 3.2)."""

from collections.abc import Sequence

from ringlight.core.camera import Camera
from ringlight.core.rendering import Rendering
from ringlight.fit.optimizer import Optimizer
from ringlight.fit.strategies.global_significance import global_significance
from ringlight.fit.strategies.stateless import Stateless
from ringlight.models.splats import SplatModel


class DropInsignificant(Stateless):
    """After the steps ``rounds``, the same share each time, so that ``share`` of all rows is gone after the last."""

    def __init__(self, rounds: Sequence[int], share: float, cameras: Sequence[Camera], volume_power: float):
        self.rounds, self.cameras, self.volume_power = frozenset(rounds), cameras, volume_power
        self.kept = (1 - share) ** (1 / max(len(self.rounds), 1))

    def update(self, step: int, model: SplatModel, optimizer: Optimizer, prediction: Rendering) -> None:
        if step not in self.rounds:
            return
        worth = global_significance(model, self.cameras, self.volume_power)
        order = worth.argsort(descending=True, stable=True)
        optimizer.edit_rows(order[: max(round(self.kept * len(model)), 1)].sort().values)
