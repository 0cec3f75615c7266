"""A small volume that is neither empty nor solid, and rays that cross it, miss it, and begin inside."""

import torch
from torch import Tensor

from ringlight.core.directions import normalize
from ringlight.data.rays import Rays
from ringlight.volume.factored import FactoredField
from ringlight.volume.factors import Decomposition
from ringlight.volume.model import VolumeModel
from ringlight.volume.occupancy import packed
from ringlight.volume.shading import FeatureShading
from ringlight.volume.tensor_train_field import TensorTrainField

BOX = torch.tensor([[-1.0, -0.9, -1.1], [1.0, 1.2, 0.9]])


def volume(kind: Decomposition = "vm", components: tuple[int, int] = (16, 48), hidden: int = 128) -> VolumeModel:
    """Components are much larger than at the start of a training, so that rays end in it; a third of it is empty."""
    drawn = torch.Generator().manual_seed(1)
    field = FactoredField(kind, (14, 17, 11), components, 27, drawn)
    with torch.no_grad():
        for parameter in field.density_factors.parameters():
            parameter.mul_(12 if kind == "vm" else 6)
        for parameter in field.appearance_factors.parameters():
            parameter.mul_(5 if kind == "vm" else 3)
    model = VolumeModel(field, FeatureShading(27, hidden, drawn), BOX)
    model.occupied = packed(torch.rand(6, 7, 16, generator=drawn) > 0.3)
    return model


def volume_of_trains() -> VolumeModel:
    """Of the same kind, as tensor trains."""
    drawn = torch.Generator().manual_seed(1)
    field = TensorTrainField(4, 4, (20, 30), 27, drawn)
    with torch.no_grad():
        for train, factor in ((field.density_train, 3.0), (field.appearance_train, 2.5)):
            for core in train.cores:
                core.mul_(factor)
    model = VolumeModel(field, FeatureShading(27, 128, drawn), BOX)
    model.occupied = packed(torch.rand(6, 7, 16, generator=drawn) > 0.3)
    return model


def rays(count: int, seed: int = 0) -> Rays:
    """Most from outside; every eighth begins inside, and every eleventh runs along an axis."""
    drawn = torch.Generator().manual_seed(seed)
    origins = 3 * normalize(torch.randn(count, 3, generator=drawn))
    origins[::8] *= 0.1
    directions = normalize(-origins + 0.7 * torch.randn(count, 3, generator=drawn))
    directions[::11] = torch.tensor([0.0, -1.0, 0.0])
    return Rays(origins, directions, torch.rand(count, generator=drawn))


BACKGROUND: Tensor = torch.tensor([1.0, 0.5, 0.2])
