"""Remove the Gaussians that matter least, in rounds (LightGaussian, Fan et al. 2023, section 3.2)."""

from collections.abc import Callable, Sequence

from jaxtyping import Float
from torch import Tensor

from ringlight.core.rendering import Rendering
from ringlight.fit.optimizer import Optimizer
from ringlight.fit.strategies.stateless import Stateless
from ringlight.models.splats import SplatModel

Worth = Callable[[SplatModel, int], Float[Tensor, "N"]]
"""How much each row matters, after a step: more is more."""


class DropInsignificant(Stateless):
    """After the steps ``rounds``, the same share each time, so that ``share`` of all rows is gone after the last."""

    def __init__(self, rounds: Sequence[int], share: float, worth: Worth):
        self.rounds, self.worth = frozenset(rounds), worth
        self.kept = (1 - share) ** (1 / max(len(self.rounds), 1))

    def update(self, step: int, model: SplatModel, optimizer: Optimizer, prediction: Rendering) -> None:
        if step not in self.rounds or self.kept == 1:
            return
        order = self.worth(model, step).argsort(descending=True, stable=True)
        optimizer.edit_rows(order[: max(round(self.kept * len(model)), 1)].sort().values)
