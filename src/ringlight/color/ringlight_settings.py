"""Settings of the RingLight colour model; free of torch, so that the command line can print them at once."""

import dataclasses
from dataclasses import dataclass
from typing import Literal

from ringlight.core.kernel_limits import RING_MAX_LATENTS
from ringlight.core.later import later
from ringlight.errors import RecipeError
from ringlight.fields.ring_settings import KnotSettings, PerceptronSettings, RingSettings, VectorMatrixSettings

MOST_GAIN = 100.0
"""Of a residual, many times what edits ask for: beyond it colours are but the two ends of their range."""

LARGEST_HIDDEN = 1024
"""Far beyond what was ever of use. It keeps a damaged or hostile model file from asking for all the memory."""


@dataclass(frozen=True)
class RingLightSettings:
    """Base colour per Gaussian plus a residual from the shared light field (RingLight-GS, section 3.2)."""

    ring: RingSettings = dataclasses.field(default_factory=RingSettings)
    """The neural tensor ring. Other fields take its sizes too, as far as they have such a size."""
    render_hidden: int = 128
    """Width of the two hidden layers that turn features into a residual colour."""
    modulation_hidden: int = 128
    """Width of the hidden layer between direction and features, and the light modulation."""
    light_modulation: bool = True
    """Whether the residual's network sees the light modulation. Without it: the paper's ablation (appendix B)."""
    modulation_as: Literal["input", "factor"] = later("input")
    """What the light modulation does. input: the residual's network sees it (eq. 8 as it stands). factor: it weighs the
    residual of a network that does not see it, as the "blending weights" of section 3.2."""
    clamp_colors: bool = later(True)
    """Whether each Gaussian's colour is clamped to [0, 1] before it is blended. Where it is, a base colour or a light
    that leaves this range gets no gradient. Without it, as in the paper's equations, only pictures are clamped."""
    latents: int = 0
    """Values per Gaussian that the residual's network sees besides feature, modulation and base colour. They let
    neighbours differ that are too close for the ring to tell apart. The paper has none (eq. 8)."""
    evaluation: Literal["tabulated", "exact"] = "tabulated"
    """tabulated reads the heads from tables, which is fast; exact runs them at every Gaussian. A model needs the one
    that it was trained with."""
    position_gradients: bool = later(False)
    """Whether the light's gradient reaches the Gaussians' positions, by the field and by the direction of view. Only
    torch can do that: a step takes six to nine times as long. The paper does not say whether it does."""
    gradient_share: float = 1.0
    """Share of the Gaussians whose light is differentiated in a step. They are drawn in proportion to their gradients
    and weighted, so that the expectation is the whole gradient (importance sampling). All Gaussians get the gradient
    of their base colour. Fields without a kernel, and other devices, differentiate all."""
    mask: bool = True
    """Whether a visibility mask is learned per Gaussian (eq. 10)."""
    mask_threshold: float = 0.01
    """A Gaussian is not drawn if its mask's sigmoid is at most this."""

    field: Literal["ring", "discrete", "cp", "tt", "vm", "mlp"] = "ring"
    """What makes the appearance features. ring: the neural tensor ring; discrete: the ring with discrete cores; cp: the
    diagonal ring; tt: the open ring (tensor train); vm: planes and lines; mlp: one network."""
    knots: KnotSettings = dataclasses.field(default_factory=KnotSettings)
    """Sizes of the field discrete."""
    vm: VectorMatrixSettings = dataclasses.field(default_factory=VectorMatrixSettings)
    """Sizes of the field vm."""
    mlp: PerceptronSettings = dataclasses.field(default_factory=PerceptronSettings)
    """Sizes of the field mlp."""
    base_color: bool = True
    """Whether each Gaussian has a base colour. Without it the residual is added to grey and the light is on from the
    first step, since there is nothing else to show. This is the paper's ablation (table 2), which leaves both open."""

    residual_gain: tuple[float, float, float] = later((1.0, 1.0, 1.0))
    """What red, green and blue of the residual are multiplied by, behind its tanh; 'ringlight edit' sets it. Training
    with others than ones runs in torch, which is slow."""

    def __post_init__(self) -> None:
        if len(self.residual_gain) != 3 or not all(0 <= gain <= MOST_GAIN for gain in self.residual_gain):
            raise RecipeError(
                f"light.residual_gain is {self.residual_gain}; give three numbers from 0 to {MOST_GAIN:g}"
            )
        for name in ("render_hidden", "modulation_hidden"):
            if not 1 <= getattr(self, name) <= LARGEST_HIDDEN:
                raise RecipeError(f"light.{name} is {getattr(self, name)}; give 1 to {LARGEST_HIDDEN}")
        if not 0 <= self.latents <= RING_MAX_LATENTS:
            raise RecipeError(f"light.latents is {self.latents}; give 0 to {RING_MAX_LATENTS} values per Gaussian")
        if not 0 < self.gradient_share <= 1:
            raise RecipeError(f"light.gradient_share is {self.gradient_share}; give a share above 0, at most 1")
        if not 0 <= self.mask_threshold < 1:
            raise RecipeError(f"light.mask_threshold is {self.mask_threshold}; a sigmoid lies between 0 and 1")
