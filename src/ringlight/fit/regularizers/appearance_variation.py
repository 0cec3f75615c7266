"""Total variation of a volume's appearance, so that what few rays tell apart is smooth.

TensoRF (Chen et al. 2022, equation 7) has it of the nodes of its factors. This one is of the field itself, at places
that are drawn, so that any field can have it.
"""

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.by_autograd import ByAutograd
from ringlight.core.randomness import generator
from ringlight.core.rendering import Rendering
from ringlight.fit.regularizers.contract import Term
from ringlight.models.contract import Model
from ringlight.volume.model import VolumeModel

EVERY = 4
"""Steps. It counts as often in those that have it; a field is asked for all drawn places at once."""

DRAWN = 16_384
"""Places of the box of which those count that rays do not skip: some thousands, a fraction of a step's samples."""


class AppearanceVariation:
    """``weight`` times the mean absolute difference of features one node apart, at places that rays do not skip."""

    buffers: tuple[str, ...] = ()

    def __init__(self, weight: float, seed: int):
        self.weight, self.seed = weight, seed

    def looks(self, step: int) -> bool:
        """See :class:`ringlight.fit.regularizers.contract.Regularizer`."""
        return step % EVERY == 0

    def term(self, step: int, model: Model, prediction: Rendering) -> Term:
        """See :class:`ringlight.fit.regularizers.contract.Regularizer`; of a volume."""
        assert isinstance(model, VolumeModel)
        both = neighbours(model, self.seed, step)
        parameters = {f"field.{name}": parameter for name, parameter in model.field.named_parameters()}
        asked = ByAutograd(lambda _: {"features": model.field.appearance(both.flatten(0, 1))}, {}, parameters)
        here, there = asked.outputs["features"].chunk(2)
        weight, apart = EVERY * self.weight / max(here.numel(), 1), here - there
        slopes = weight * apart.sign()
        gradients = asked.backward({"features": torch.cat([slopes, -slopes])})
        return Term(weight * apart.abs().sum(), grad_parameters=gradients)


@torch.no_grad()
def neighbours(model: VolumeModel, seed: int, step: int) -> Float[Tensor, "2 P 3"]:
    """Places of the box's [0, 1]^3 that rays do not skip, drawn evenly, and then the places one node further along an
    axis of each one's own, or at the box's end."""
    drawn = generator(seed, step, "variation")
    places = torch.rand(DRAWN, 3, generator=drawn).to(model.box)
    axes = torch.randint(places.shape[1], (DRAWN, 1), generator=drawn).to(model.device)
    pitches = 1 / torch.tensor(model.intervals).to(model.box)
    further = places.scatter_add(1, axes, pitches[axes]).clamp_max(1)
    kept = model.is_kept(places)
    return torch.stack([places[kept], further[kept]])
