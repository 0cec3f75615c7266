"""Materials and an environment that show, for a short run of gaussian-shader: sixty steps leave an even, white
environment, in which nothing could be seen that is looked up at a wrong place."""

from pathlib import Path

import torch

from ringlight.color.shaded_gaussians import ROUGHNESS, TINTS, ShadedGaussians
from ringlight.methods.store import save_model
from ringlight.runs.opened import open_model

BLOCK = 4
"""Texels along a side that have one colour."""


@torch.no_grad()
def polish(folder: Path, opacity_logit: float = 1.0) -> None:
    """Replace the run's model. Roughnesses are anything from 0.1 to 0.9."""
    stored, drawn = open_model(folder).stored, torch.Generator().manual_seed(0)
    model = stored.model.splats()
    assert model is not None
    assert isinstance(model.color, ShadedGaussians)
    texels = model.color.light.texels
    blocks = 2 * torch.randn(6, texels.shape[1] // BLOCK, texels.shape[1] // BLOCK, 3, generator=drawn)
    texels.copy_(blocks.repeat_interleave(BLOCK, 1).repeat_interleave(BLOCK, 2))
    for name, low, high in ((ROUGHNESS, -4, 2), (TINTS, -1, 3), ("normal_residuals", -0.2, 0.2)):
        column = model.columns[name]
        column.copy_(low + (high - low) * torch.rand(column.shape, generator=drawn))
    model.columns["opacity_logits"].fill_(opacity_logit)
    model.columns["sh_dc"].fill_(-1.5)  # dark, so that pictures are not white
    save_model(folder / "model.safetensors", stored.model, stored.header, stored.cameras)
