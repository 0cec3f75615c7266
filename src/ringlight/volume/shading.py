"""Colour of features and a direction: sines and cosines of both, and a small network (TensoRF's "MLP_Fea")."""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ringlight.core.kernel_limits import VOLUME_FREQUENCIES as FREQUENCIES
from ringlight.fields.networks import perceptron

COLORS = 3


def inputs_of(features: int) -> int:
    """Features, direction, and a sine and a cosine of each at each frequency."""
    return (features + 3) * (1 + 2 * FREQUENCIES)


class FeatureShading(nn.Module):
    """Colours [N 3] in (0, 1) of features [N F] and unit directions [N 3]; with 27 features and 128
    units 150-128-128-3."""

    def __init__(self, features: int, hidden: int, generator: torch.Generator):
        super().__init__()
        self.features, self.hidden_units = features, hidden
        self.network = perceptron((inputs_of(features), hidden, hidden, COLORS), generator)
        with torch.no_grad():
            last = self.network[-1]
            assert isinstance(last, nn.Linear)
            last.bias.zero_()

    def forward(self, features: Float[Tensor, "N F"], directions: Float[Tensor, "N 3"]) -> Float[Tensor, "N 3"]:
        rows = torch.cat([features, directions, waves(features), waves(directions)], -1)
        colors: Tensor = self.network(rows).sigmoid()
        return colors


def named_layers(shading: FeatureShading) -> dict[str, Tensor]:
    """Weight and bias of each layer, by their names in a model."""
    return {f"shading.{name}": tensor for name, tensor in shading.named_parameters()}


def waves(values: Float[Tensor, "N C"]) -> Float[Tensor, "N W"]:
    """Sines of each value at each frequency, then cosines."""
    scaled = torch.cat([values * 2**k for k in range(FREQUENCIES)], -1)
    return torch.cat([scaled.sin(), scaled.cos()], -1)
