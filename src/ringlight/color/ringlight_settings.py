"""Settings of the RingLight colour model; free of torch, so that the command line can print them at once."""

import dataclasses
from dataclasses import dataclass
from typing import Literal

from ringlight.core.kernel_limits import RING_MAX_LATENTS
from ringlight.errors import RecipeError
from ringlight.fields.ring_settings import KnotSettings, PerceptronSettings, RingSettings, VectorMatrixSettings

LARGEST_HIDDEN = 1024
"""Far beyond what was ever of use: a damaged or hostile model file may not ask for all the memory there is."""


@dataclass(frozen=True)
class RingLightSettings:
    """Base colour per Gaussian plus a residual from the shared light field (RingLight-GS, section 3.2)."""

    ring: RingSettings = dataclasses.field(default_factory=RingSettings)
    """The neural tensor ring; its sizes, where they have a meaning, are those of the other fields too."""
    render_hidden: int = 128
    """Width of the two hidden layers that turn features into a residual colour."""
    modulation_hidden: int = 128
    """Width of the hidden layer that makes the light modulation of direction and features."""
    light_modulation: bool = True
    """Whether the light modulation is fed to the residual's network; without is the paper's ablation (appendix B)."""
    latents: int = 0
    """Values per Gaussian that the residual's network sees besides feature, modulation and base colour; 0 as in the
    paper (eq. 8). By them neighbours can differ that are too close for the ring to give them different features."""
    evaluation: Literal["tabulated", "exact"] = "tabulated"
    """Heads read from tables (fast), or run at every Gaussian (the slow twin). A model belongs to the one it was
    trained with."""
    gradient_share: float = 1.0
    """Share of the Gaussians whose light is differentiated in a step, drawn by lot in proportion to their gradients and
    weighted, so that the expectation is the same; all of them still get their base colour's gradient. By kernel only:
    other fields and other devices differentiate all."""
    mask: bool = True
    """Whether a visibility mask is learned per Gaussian (eq. 10)."""
    mask_threshold: float = 0.01
    """Gaussians whose mask's sigmoid is at or below this are not drawn."""

    field: Literal["ring", "discrete", "cp", "tt", "vm", "mlp"] = "ring"
    """What makes the appearance features: the neural tensor ring, the ring with discrete cores, the diagonal ring, the
    open ring (tensor train), planes and lines, or one network."""
    knots: KnotSettings = dataclasses.field(default_factory=KnotSettings)
    """Only of the field "discrete"."""
    vm: VectorMatrixSettings = dataclasses.field(default_factory=VectorMatrixSettings)
    """Only of the field "vm"."""
    mlp: PerceptronSettings = dataclasses.field(default_factory=PerceptronSettings)
    """Only of the field "mlp"."""
    base_color: bool = True
    """Whether each Gaussian has a base colour. Without it the residual is added to grey, and the field lit from the
    first step, since there is nothing else to show: the paper's ablation (table 2), which leaves both open."""

    def __post_init__(self) -> None:
        for name in ("render_hidden", "modulation_hidden"):
            if not 1 <= getattr(self, name) <= LARGEST_HIDDEN:
                raise RecipeError(f"light.{name} is {getattr(self, name)}; give 1 to {LARGEST_HIDDEN}")
        if not 0 <= self.latents <= RING_MAX_LATENTS:
            raise RecipeError(f"light.latents is {self.latents}; give 0 to {RING_MAX_LATENTS} values per Gaussian")
        if not 0 < self.gradient_share <= 1:
            raise RecipeError(f"light.gradient_share is {self.gradient_share}; give a share above 0, at most 1")
        if not 0 <= self.mask_threshold < 1:
            raise RecipeError(f"light.mask_threshold is {self.mask_threshold}; a sigmoid lies between 0 and 1")
