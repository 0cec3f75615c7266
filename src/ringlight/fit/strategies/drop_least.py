"""Remove the Gaussians that add least to the training photographs, once density control has ended."""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import Gradients
from ringlight.core.rendering import Emission, Rendering
from ringlight.core.want import Want
from ringlight.fit.optimizer import Optimizer
from ringlight.fit.strategies.densify_settings import DensifySettings
from ringlight.fit.strategies.removal_effects import opacities_vary, removal_effects
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

    def _worth(self, step: int, model: SplatModel) -> Float[Tensor, "N"]:
        if self.by == "weights":
            return blending_weights(model, self.cameras)
        return removal_effects(model, self.cameras, self.background, self.seed, step)


def blending_weights(model: SplatModel, cameras: Sequence[Camera]) -> Float[Tensor, "N"]:
    """Each row's alpha times transmittance, summed over all pixels of all ``cameras``, in pixels.

    A row's weight is what the picture's sum gains by its colour: a gradient, which any rasterizer gives.
    """
    table = Gaussians.from_columns({name: column.detach() for name, column in model.columns.items()})
    wanted, total = model.color.wanted(table).to(table.means), torch.zeros_like(table.opacity_logits)
    black, vary = torch.zeros(3), opacities_vary(model, cameras)
    for camera in cameras:
        towards = model.color.emit(table, camera, ("rgb",), Want.EXACT).opacity_factor if vary else None
        factor = wanted if towards is None else wanted * towards.detach()
        emission = Emission({"rgb": 3}, torch.zeros_like(table.means), factor)
        raster = model.rasterize.draw(table, emission, camera, black, model.options, Want.GRADIENTS)
        first = torch.zeros_like(raster.image)
        first[..., 0] = 1
        grad_channels, _ = raster.backward(first, None, Gradients())
        total += grad_channels[:, 0]
    return total
