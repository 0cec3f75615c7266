"""Remove the Gaussians that add least to the training photographs, once density control has ended."""

from collections.abc import Sequence

from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.rendering import Rendering
from ringlight.fit.optimizer import Optimizer
from ringlight.fit.strategies.blending_weights import blending_weights
from ringlight.fit.strategies.densify_settings import DensifySettings
from ringlight.fit.strategies.hidden import seen_shares
from ringlight.fit.strategies.removal_effects import removal_effects
from ringlight.fit.strategies.stateless import Stateless
from ringlight.models.splats import SplatModel


class DropLeast(Stateless):
    """In each round, drop those rows that add least to the pictures of all ``cameras``, as ``settings.drop_by`` says.

    Density control cannot know what its children will be good for; a while later the photographs tell. Growing more
    and dropping it again leaves better Gaussians than growing fewer (after LightGaussian, Fan et al. 2023, which drops
    from finished models).
    """

    def __init__(
        self,
        settings: DensifySettings,
        cameras: Sequence[Camera],
        steps: int,
        background: Float[Tensor, "3"],
        seed: int,
    ):
        self.rounds, self.cameras, self.bound = settings.drop_rounds(steps), cameras, settings.max_gaussians
        self.by, self.background, self.seed = settings.drop_by, background, seed
        self.exact = settings.kind == "mcmc"
        self.hidden = 0.0 if self.exact else settings.growth(steps).drop_hidden
        self.kept = (1 - settings.growth(steps).drop_share) ** (1 / max(len(self.rounds), 1))

    def update(self, step: int, model: SplatModel, optimizer: Optimizer, prediction: Rendering) -> None:
        if step not in self.rounds:
            return
        left = int(self.kept * len(model))
        if self.bound and step == max(self.rounds):
            # Density control may have begun with more than it was to end with; a budget is met to the row.
            left = self.bound if self.exact else min(left, self.bound)
        order = self._worth(step, model).argsort(descending=True, stable=True)
        optimizer.edit_rows(order[: max(left, 1)].sort().values)
        if self.hidden and step == max(self.rounds):
            seen = seen_shares(model, self.cameras).argsort(stable=True)
            optimizer.edit_rows(seen[int(self.hidden * len(model)) :].sort().values)

    def _worth(self, step: int, model: SplatModel) -> Float[Tensor, "N"]:
        if self.by == "weights":
            return blending_weights(model, self.cameras)
        return removal_effects(model, self.cameras, self.background, self.seed, step)
