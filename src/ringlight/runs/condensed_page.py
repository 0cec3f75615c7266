"""A 3iGS model as a page holds it: condensed, and in steps of what its colours show."""

from collections.abc import Mapping
from dataclasses import asdict, replace

import torch
from torch import Tensor

from ringlight.color.condensed_illumination import (
    CODED,
    Condensed,
    condensed,
    condensed_settings,
    with_components,
    worth_keeping,
)
from ringlight.color.illuminated import Illuminated
from ringlight.files.model_file import ModelHeader
from ringlight.files.packed import Packed, pack_tensors
from ringlight.files.packing_plan import PLAN, Plan
from ringlight.models.splats import SplatModel

STEP, COARSE_STEP = 1 / 500, 1 / 250
"""Of a component, in colours, white being one."""

PAGE_PLAN: Plan = (("columns.roughness", "fixed8"), ("color.network.weights.0", "half"), *PLAN)
"""The first layer's weights multiply components of any size, so that a byte of them would show."""


class CondensedPage:
    """A model's light condensed once, and packed as coarsely as is asked, for all of its rows or some."""

    def __init__(self, color: Illuminated, model: SplatModel):
        self._found: Condensed = condensed(color, model.gaussians)

    def tensors(self, tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """The model's tensors, condensed, with all components."""
        return dict(tensors) | self._found.tensors

    def packed(self, tensors: Mapping[str, Tensor], coarse: bool) -> Packed:
        """With the components that are worth it."""
        step = self._found.unit * (COARSE_STEP if coarse else STEP)
        kept = worth_keeping(tensors[CODED], step)
        steps = {CODED: torch.full((kept,), step, dtype=torch.float64)}
        return pack_tensors(with_components(tensors, kept), PAGE_PLAN, coarse, steps)


def condensed_header(header: ModelHeader, color: Illuminated, tensors: Mapping[str, Tensor]) -> ModelHeader:
    """What the header of a model file with these condensed tensors would say."""
    light = condensed_settings(color.settings, tensors[CODED].shape[1])
    return replace(header, recipe=header.recipe | {"light": asdict(light)})
