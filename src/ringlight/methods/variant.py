"""One row of a study: a preset with settings changed, so that its run is one that ``ringlight train`` could make."""

from dataclasses import dataclass
from typing import Literal

from ringlight.methods.splat_recipe import SplatRecipe


@dataclass(frozen=True)
class SizeBound:
    """At most this share of the raw bytes that the variant ``of`` ends with, with the same seed.

    Kept where density control drops Gaussians, in runs of 1,250 steps or more; a shorter one may end with as many as it
    began with.
    """

    of: str
    share: float


@dataclass(frozen=True)
class Curve:
    """The curve of a study that a variant is a dot of: its name, and what changes along it."""

    name: str
    along: Literal["size", "length"]


@dataclass(frozen=True)
class Variant:
    """``paper`` is the PSNR that the paper reports for it, dB, mean over Shiny-Blender."""

    name: str
    preset: str
    recipe: SplatRecipe
    about: str
    at: float | None = None
    """The number that the study varies, where it varies one."""
    paper: float | None = None
    as_many_as: str | None = None
    """The variant whose number of Gaussians, at the end and with the same seed, bounds this one's."""
    within: SizeBound | None = None
    """The bound on this one's bytes."""
    curves: tuple[Curve, ...] = ()

    @property
    def waits_for(self) -> str | None:
        """The variant that has to be measured before this one can be trained."""
        return self.within.of if self.within is not None else self.as_many_as
