"""From features to colour (RingLight-GS, eq. 5 and 8): light modulation, residual, sum with the base colour."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ringlight.color.ringlight_settings import RingLightSettings
from ringlight.fields.networks import perceptron


@dataclass(frozen=True)
class LitColor:
    """``color`` is base + residual, clamped to [0, 1] unless the settings say otherwise; ``residual`` in (-1, 1);
    ``modulation`` in (0, 1)."""

    color: Float[Tensor, "N 3"]
    residual: Float[Tensor, "N 3"]
    modulation: Float[Tensor, "N 1"]


class RenderModule(nn.Module):
    """c_r = tanh(MLP(a, m, c_b, latents)) with a = tanh(features) and m = sigmoid(MLP(v, a)).

    Where the modulation is a factor, c_r = m tanh(MLP(a, c_b, latents)): the other reading of equation 8. The latents
    are values of each Gaussian's own; the paper has none (eq. 8). Without light modulation the networks are as in the
    paper's ablation, and m is reported as one.
    """

    def __init__(self, settings: RingLightSettings, generator: torch.Generator):
        super().__init__()
        features, hidden = settings.ring.features, settings.render_hidden
        self.latents, self.clamps = settings.latents, settings.clamp_colors
        self.weighs = settings.light_modulation and settings.modulation_as == "factor"
        self.gain = None if set(settings.residual_gain) == {1.0} else settings.residual_gain
        self.modulation: nn.Sequential | None = None
        if settings.light_modulation:
            self.modulation = perceptron((3 + features, settings.modulation_hidden, 1), generator)
        inputs = features + (1 if settings.light_modulation and not self.weighs else 0) + 3 + settings.latents
        self.render = perceptron((inputs, hidden, hidden, 3), generator)

    def forward(
        self,
        features: Float[Tensor, "N C"],
        directions: Float[Tensor, "N 3"],
        base: Float[Tensor, "N 3"],
        latents: Float[Tensor, "N L"],
    ) -> LitColor:
        """``directions`` unit, from the camera to the point; ``base`` in [0, 1]; L may be 0."""
        inputs, modulation = self.inputs(features, directions, base, latents)
        residual = torch.tanh(self.render(inputs))
        if self.weighs:
            residual = modulation * residual
        return self.gained(LitColor(base + residual, residual, modulation), base)

    def gained(self, lit: LitColor, base: Float[Tensor, "N 3"]) -> LitColor:
        """The same with the settings' gain of the residual, which kernels do not know; ``base`` in [0, 1]."""
        residual = lit.residual if self.gain is None else lit.residual * base.new_tensor(self.gain)
        return LitColor(self.shown(base + residual), residual, lit.modulation)

    def shown(self, colors: Float[Tensor, "N 3"]) -> Float[Tensor, "N 3"]:
        """What a Gaussian emits of the sum of its base colour and its residual."""
        return colors.clamp(0, 1) if self.clamps else colors

    def inputs(
        self,
        features: Float[Tensor, "N C"],
        directions: Float[Tensor, "N 3"],
        base: Float[Tensor, "N 3"],
        latents: Float[Tensor, "N L"],
    ) -> tuple[Float[Tensor, "N I"], Float[Tensor, "N 1"]]:
        """What the residual's network sees, and the light modulation, which is among it if there is any."""
        activated = torch.tanh(features)
        modulation = torch.ones_like(base[:, :1])
        if self.modulation is not None:
            modulation = torch.sigmoid(self.modulation(torch.cat([directions, activated], -1)))
        seen = [modulation] if self.modulation is not None and not self.weighs else []
        return torch.cat([activated, *seen, base, latents], -1), modulation
