"""Whether a file's tensors fit its recipe, found out before memory is asked for what the recipe promises."""

from collections.abc import Mapping

import torch
from torch import Tensor

from ringlight.methods.recipe import Recipe
from ringlight.rasterize.contract import Rasterizer


def refuse_misfits(recipe: Recipe, box: Tensor, rasterize: Rasterizer, tensors: Mapping[str, Tensor]) -> None:
    """Raise KeyError or ValueError unless ``tensors`` are what the recipe's model holds, with any number of rows.

    The model is built on torch's meta device, where tensors have shapes and no memory.
    """
    with torch.device("meta"):
        outline = recipe.model(box, rasterize)
    expected = outline.state_dict()
    missing = outline.rendering_tensors().keys() - tensors.keys()
    if missing:
        raise KeyError(f"tensor {min(missing)!r} is missing")
    rows = next((tensor.shape[:1] for name, tensor in tensors.items() if name.startswith(outline.row_prefixes)), ())
    for name, tensor in tensors.items():
        if name not in expected:
            raise KeyError(f"tensor {name!r} is unknown")
        shape = tuple(expected[name].shape)
        if name.startswith(outline.row_prefixes):
            shape = (*rows, *shape[1:])
        if tuple(tensor.shape) != shape or tensor.dtype != expected[name].dtype:
            raise ValueError(f"tensor {name!r} is {tensor.dtype} of shape {list(tensor.shape)}, not {list(shape)}")
