"""One network over encoded position and direction: the field without a tensor ring (the paper's "w/o TR").

a = MLP(gamma(x, y, z), gamma(v))
"""

from itertools import pairwise

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ringlight.core.want import Want
from ringlight.fields.encoding import fourier_features
from ringlight.fields.heads import AXES, position_code, view_code
from ringlight.fields.networks import perceptron
from ringlight.fields.ring_settings import PerceptronSettings, RingSettings


class PerceptronField(nn.Module):
    """Features [N C] of points in [-1, 1]^3 and unit directions; a ``LightField``.

    The codes of both inputs, and the number of features, are the ring's; see ``PerceptronSettings`` for the width.
    """

    def __init__(self, ring: RingSettings, settings: PerceptronSettings, generator: torch.Generator):
        super().__init__()
        self.code, self.view_code = position_code(ring), view_code(ring)
        hidden = settings.hidden or matched_width(ring, settings.layers)
        self.network = perceptron(_widths(ring, settings.layers, hidden), generator)

    def exact(self, points: Float[Tensor, "N 3"], directions: Float[Tensor, "N 3"]) -> Float[Tensor, "N C"]:
        encoded = [fourier_features(points, self.code), fourier_features(directions, self.view_code)]
        features: Tensor = self.network(torch.cat(encoded, -1))
        return features

    def tables(self, want: Want) -> None:
        """None: it is no function of one coordinate at a time."""

    def differentiable_tables(self) -> None:
        """None likewise."""


def ring_size(ring: RingSettings) -> int:
    """Numbers that the neural ring of these settings holds."""
    hidden, matrix = ring.head_hidden, ring.rank**2
    axis = _size((position_code(ring).width(1), hidden, hidden, matrix))
    view = _size((view_code(ring).width(AXES), hidden, hidden, matrix))
    return AXES * axis + view + (ring.features * matrix if ring.core == "free" else axis)


def matched_width(ring: RingSettings, layers: int) -> int:
    """The width of the hidden layers at which the network's size is nearest to the ring's."""
    wanted = ring_size(ring)
    width = 1
    while _size(_widths(ring, layers, width + 1)) <= wanted:
        width += 1
    below, above = (abs(_size(_widths(ring, layers, w)) - wanted) for w in (width, width + 1))
    return width if below <= above else width + 1


def _widths(ring: RingSettings, layers: int, hidden: int) -> tuple[int, ...]:
    inputs = position_code(ring).width(AXES) + view_code(ring).width(AXES)
    return (inputs, *([hidden] * layers), ring.features)


def _size(widths: tuple[int, ...]) -> int:
    """Weights and biases of a perceptron."""
    return sum((inputs + 1) * outputs for inputs, outputs in pairwise(widths))
