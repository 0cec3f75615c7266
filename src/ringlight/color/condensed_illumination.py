"""A 3iGS model with fewer numbers and no field, for those who only look at it.

Of what the network's first layer adds up, the Gaussian's features and the field at its centre do not depend on the
view. These sums [N H] are brought to principal components, which take the place of the features: what is left is an
:class:`Illuminated` of other settings, whose field is zero. Components are those of a Karhunen-Loève transform, with
lengths measured by what they change in the colours of all directions, so that equal steps show equally and what no
colour shows takes no number. Of a toaster after 1,000 steps 64 components 66 dB from the model take 0.7 MB deflated,
features and the field's in bytes 2.3 MB, features and the planes 4.5 MB.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.color.illuminated import FEATURES, ROUGHNESS, Illuminated, roughness_of
from ringlight.color.illumination_settings import IlluminationSettings
from ringlight.core.directions import normalize
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import COLOR, COLUMNS
from ringlight.core.light_features import evenly
from ringlight.core.randomness import generator
from ringlight.fields.directional_encoding import directional_encoding
from ringlight.fields.illumination import Illumination

CODED = COLUMNS + FEATURES
FIRST_WEIGHTS, FIRST_BIASES = f"{COLOR}network.weights.0", f"{COLOR}network.biases.0"

MOST_WATCHED, LOOKS = 1500, 4
"""Gaussians whose colours say what shows, and random directions from which each is looked at."""

LEAST_SHOWN = 0.1
"""Of the mean, added to how much each of the sums shows: rounding also moves units over their kinks, which no gradient
tells."""

STRAIGHT = 4.0
"""Times the largest component is what a feature of one stands for: there tanh is a line but for a fiftieth."""

FEWEST = 3
"""Components, as the settings ask."""

NARROW = 0.4
"""A component of a smaller standard deviation, in steps, is left out: nearly all of it would be rounded to zero."""


@dataclass(frozen=True)
class Condensed:
    """``tensors`` of an :class:`Illuminated` by the names of model files, all components, those that show most first.

    ``unit`` is what a feature changes by where a colour changes by one.
    """

    tensors: dict[str, Tensor]
    unit: float


def condensed_settings(settings: IlluminationSettings, components: int) -> IlluminationSettings:
    """Of a model with so many components."""
    return replace(settings, side=2, components=1, features=components)


@torch.no_grad()
def condensed(color: Illuminated, gaussians: Gaussians) -> Condensed:
    """The same colours, but for rounding, of at most min(2F, H) components."""
    first, count = color.network.weights[0][0].double(), color.settings.features
    features = gaussians.appearance[FEATURES].double().tanh()
    light = color.field(color.unit_points(gaussians.means)).double().tanh()
    sums = torch.cat([features, light], -1) @ first[: 2 * count]
    middle = sums.mean(0)
    shown, powers = _square_roots(_sensitivity(color, gaussians, sums))
    scaled = (sums - middle) @ shown
    _, axes = torch.linalg.eigh(scaled.T @ scaled)
    axes = axes.flip(-1)[:, : 2 * count]
    values = scaled @ axes
    scale = STRAIGHT * float(values.abs().amax()) or 1.0
    kept = values.shape[1]
    ahead = torch.cat([scale * axes.T @ powers, first.new_zeros(kept, len(middle)), first[2 * count :]])
    less = condensed_settings(color.settings, kept)
    field = Illumination(less.side, less.components, less.features, generator(0, 0, "networks")).state_dict()
    tensors = {f"{COLOR}field.{name}": torch.zeros_like(tensor) for name, tensor in field.items()}
    tensors |= {
        CODED: (values / scale).atanh().float(),
        FIRST_WEIGHTS: ahead[None].float(),
        FIRST_BIASES: (color.network.biases[0].double() + middle).float(),
    }
    return Condensed(tensors, 1 / scale)


def worth_keeping(features: Float[Tensor, "N K"], step: float) -> int:
    """How many of the components, the first ones, are as wide as a few steps of a feature."""
    wide = features.double().square().mean(0).sqrt() > NARROW * step
    return min(max(int(wide.sum()), FEWEST), features.shape[1])


def with_components(tensors: Mapping[str, Tensor], kept: int) -> dict[str, Tensor]:
    """Tensors of :func:`condensed` with the first components alone."""
    count, weights = tensors[CODED].shape[1], tensors[FIRST_WEIGHTS]
    return dict(tensors) | {
        CODED: tensors[CODED][:, :kept].contiguous(),
        f"{COLOR}field.mix": tensors[f"{COLOR}field.mix"][:kept],
        f"{COLOR}field.offset": tensors[f"{COLOR}field.offset"][:kept],
        FIRST_WEIGHTS: torch.cat([weights[:, :kept], weights[:, count : count + kept], weights[:, 2 * count :]], 1),
    }


def _sensitivity(color: Illuminated, gaussians: Gaussians, sums: Float[Tensor, "N H"]) -> Float[Tensor, "H H"]:
    """Mean of J^T J over Gaussians and directions, J the colours' Jacobian by the first layer's sums, and a part of its
    mean eigenvalue so that it can be inverted."""
    rows = evenly(len(sums), MOST_WATCHED).repeat_interleave(LOOKS)
    directions = normalize(torch.randn(len(rows), 3, generator=generator(0, 0, "looks"), dtype=sums.dtype))
    code = directional_encoding(directions, roughness_of(gaussians.appearance[ROUGHNESS][rows]).double())
    (first, *weights), (bias, *biases) = (
        [parameter[0].detach().double() for parameter in layers]
        for layers in (color.network.weights, color.network.biases)
    )
    seen = torch.cat([directions, code], -1) @ first[2 * color.settings.features :] + bias
    with torch.enable_grad():
        hidden = inputs = (sums[rows] + seen).requires_grad_()
        for weight, offset in zip(weights, biases, strict=True):
            hidden = torch.relu(hidden) @ weight + offset
        # Rows do not know each other: the gradient of a sum over them holds each row's own.
        of_colors = [torch.autograd.grad(one.sum(), inputs, retain_graph=True)[0] for one in hidden.tanh().unbind(-1)]
    found = sum(gradient.T @ gradient for gradient in of_colors) / len(rows)
    assert isinstance(found, Tensor)
    least = LEAST_SHOWN * found.trace() / len(found)
    return found + least.clamp_min(torch.finfo(found.dtype).eps) * torch.eye(len(found), dtype=found.dtype)


def _square_roots(matrix: Float[Tensor, "H H"]) -> tuple[Float[Tensor, "H H"], Float[Tensor, "H H"]]:
    """Of a positive matrix, and of its inverse."""
    values, vectors = torch.linalg.eigh(matrix)
    root = values.sqrt()
    return (vectors * root) @ vectors.T, (vectors / root) @ vectors.T
