"""Whether a file's tensors fit its recipe, found out before memory is asked for what the recipe promises."""

from collections.abc import Mapping

import torch
from torch import Tensor

from ringlight.core.gaussians import Gaussians
from ringlight.core.scene import PointCloud
from ringlight.methods.recipe import Recipe
from ringlight.models.splats import COLUMNS_PREFIX
from ringlight.rasterize.contract import Rasterizer


def refuse_misfits(recipe: Recipe, box: Tensor, rasterize: Rasterizer, tensors: Mapping[str, Tensor]) -> None:
    """Raise KeyError or ValueError unless ``tensors`` are what the recipe's model holds, with any number of rows.

    The model is built on torch's meta device, where tensors have shapes and no memory.
    """
    geometry = Gaussians(torch.zeros(0, 3), torch.zeros(0, 3), torch.zeros(0, 4), torch.zeros(0))
    with torch.device("meta"):
        outline = recipe.model(geometry, box, rasterize)
    one = torch.zeros(1, 3)
    columns = geometry.columns() | outline.color.new_columns(PointCloud(one, one))
    expected = outline.state_dict() | {COLUMNS_PREFIX + name: column for name, column in columns.items()}
    needed = expected.keys() - {COLUMNS_PREFIX + name for name in outline.color.training_columns}
    if needed - tensors.keys():
        raise KeyError(f"tensor {min(needed - tensors.keys())!r} is missing")
    rows = tensors[f"{COLUMNS_PREFIX}means"].shape[:1]
    for name, tensor in tensors.items():
        if name not in expected:
            raise KeyError(f"tensor {name!r} is unknown")
        shape = expected[name].shape
        if name.startswith(COLUMNS_PREFIX):
            shape = (*rows, *shape[1:])
        if tuple(tensor.shape) != tuple(shape) or tensor.dtype != expected[name].dtype:
            raise ValueError(f"tensor {name!r} is {tensor.dtype} of shape {list(tensor.shape)}, not {list(shape)}")
