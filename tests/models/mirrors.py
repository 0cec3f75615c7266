"""Mirrors that show something, for tests of their pictures."""

import torch

from ringlight.bench.step import subject_of_workload
from ringlight.bench.workload import Size, workload_camera
from ringlight.core.camera import Camera
from ringlight.methods.table import METHODS
from ringlight.models.splats import SplatModel
from ringlight.rasterize.choose import rasterizer_for
from small_recipes import with_settings

WHITE = torch.ones(3)
LIKE_TRAINED = 0.47
"""Times the width, the last layer's weights: residuals are then a quarter of the colours' range, root mean square,
whether it is 32 or 64."""

WEIGHT = 0.1
"""Of a shared function, whose coefficients are 0.3 at the start."""


def mirror(size: str = "600@96", **shader: object) -> SplatModel:
    """The workload's ball as a mirror, with residuals as large as those of a trained one."""
    recipe = with_settings(METHODS["ringlight-mirror"], {"shader": shader})
    model = subject_of_workload("ringlight-mirror", recipe, Size.parse(size), rasterizer_for("cpu")).training.model
    drawn = torch.Generator().manual_seed(3)
    with torch.no_grad():
        for name, parameter in model.shader.named_parameters():
            if name.startswith("maps"):
                parameter.copy_(torch.randn(parameter.shape, generator=drawn))
            if name.startswith("places"):
                parameter.copy_(1 + 0.3 * torch.randn(parameter.shape, generator=torch.Generator().manual_seed(4)))
        model.get_parameter("columns.normals").copy_(torch.randn(len(model), 3, generator=drawn))
        model.get_buffer("color.varying.active_degree").fill_(3)
        weights = model.get_parameter("columns.basis_weights")
        weights.copy_(WEIGHT * torch.randn(weights.shape, generator=torch.Generator().manual_seed(5)))
        last = f"shader.mlp.{2 * recipe.shader.hidden_layers}.weight"
        model.get_parameter(last).mul_(LIKE_TRAINED * recipe.shader.hidden)
    return model.eval()


def view(width: int = 96, height: int = 96, turn: float = 0.3) -> Camera:
    return workload_camera(96, turn_y=turn).resized(width, height)
