"""Remove rows that the image does not need, after densification has ended."""

from ringlight.core.rendering import Rendering
from ringlight.fit.optimizer import Optimizer
from ringlight.fit.strategies.stateless import Stateless
from ringlight.models.splats import SplatModel


class Prune(Stateless):
    """Every ``every`` steps after ``begin``, and before ``until`` if it is given: drop rows fainter than ``opacity`` or
    no longer wanted by the colour."""

    def __init__(self, begin: int, every: int, opacity: float, until: int | None = None):
        self.begin, self.every, self.opacity, self.until = begin, every, opacity, until

    def update(self, step: int, model: SplatModel, optimizer: Optimizer, prediction: Rendering) -> None:
        if step <= self.begin or step % self.every or (self.until is not None and step >= self.until):
            return
        table = model.gaussians
        keep = ((table.opacities >= self.opacity) & model.color.wanted(table)).nonzero()[:, 0]
        if 0 < len(keep) < len(model):
            optimizer.edit_rows(keep)
