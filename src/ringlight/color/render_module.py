"""From features to colour (RingLight-GS, eq. 5 and 8): light modulation, residual, sum with the base colour."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ringlight.color.ringlight_settings import RingLightSettings
from ringlight.fields.networks import perceptron


@dataclass(frozen=True)
class LitColor:
    """``color`` in [0, 1] is base + residual, clamped; ``residual`` in (-1, 1); ``modulation`` in (0, 1)."""

    color: Float[Tensor, "N 3"]
    residual: Float[Tensor, "N 3"]
    modulation: Float[Tensor, "N 1"]


class RenderModule(nn.Module):
    """c_r = tanh(MLP(a, m, c_b, latents)) with a = tanh(features) and m = sigmoid(MLP(v, a)).

    The latents are values of each Gaussian's own; the paper has none (eq. 8). Without light modulation the networks are
    as in the paper's ablation, and m is reported as one.
    """

    def __init__(self, settings: RingLightSettings, generator: torch.Generator):
        super().__init__()
        features, hidden = settings.ring.features, settings.render_hidden
        self.latents = settings.latents
        self.modulation: nn.Sequential | None = None
        if settings.light_modulation:
            self.modulation = perceptron((3 + features, settings.modulation_hidden, 1), generator)
        inputs = features + (1 if settings.light_modulation else 0) + 3 + settings.latents
        self.render = perceptron((inputs, hidden, hidden, 3), generator)

    def forward(
        self,
        features: Float[Tensor, "N C"],
        directions: Float[Tensor, "N 3"],
        base: Float[Tensor, "N 3"],
        latents: Float[Tensor, "N L"],
    ) -> LitColor:
        """``directions`` unit, from the camera to the point; ``base`` in [0, 1]; L may be 0."""
        activated = torch.tanh(features)
        if self.modulation is None:
            modulation, inputs = torch.ones_like(base[:, :1]), [activated, base, latents]
        else:
            modulation = torch.sigmoid(self.modulation(torch.cat([directions, activated], -1)))
            inputs = [activated, modulation, base, latents]
        residual = torch.tanh(self.render(torch.cat(inputs, -1)))
        return LitColor((base + residual).clamp(0, 1), residual, modulation)
