"""The light fields by name, as the setting ``light.field`` chooses them."""

from collections.abc import Callable

import torch

from ringlight.color.ringlight_settings import RingLightSettings
from ringlight.fields.contract import LightField
from ringlight.fields.diagonal_ring import DiagonalRing
from ringlight.fields.discrete_ring import DiscreteRing
from ringlight.fields.perceptron_field import PerceptronField
from ringlight.fields.tensor_ring import TensorRing
from ringlight.fields.tensor_train import TensorTrain
from ringlight.fields.vector_matrix import VectorMatrix

Maker = Callable[[RingLightSettings, torch.Generator], LightField]

FIELDS: dict[str, Maker] = {
    "ring": lambda light, generator: TensorRing(light.ring, generator),
    "discrete": lambda light, generator: DiscreteRing(light.ring, light.knots, generator),
    "cp": lambda light, generator: DiagonalRing(light.ring, generator),
    "tt": lambda light, generator: TensorTrain(light.ring, generator),
    "vm": lambda light, generator: VectorMatrix(light.ring.features, light.vm, generator),
    "mlp": lambda light, generator: PerceptronField(light.ring, light.mlp, generator),
}
"""Every name is also that of the module in the colour model: parameters are called ``color.NAME...``."""
