"""A volume takes tensors over that may be of another resolution than its own."""

from collections.abc import Mapping

import torch
from torch import Tensor, nn

from ringlight.volume.contract import VolumeField
from ringlight.volume.grids import FEWEST_NODES, MOST_NODES
from ringlight.volume.occupancy import BITS, MOST_CELLS


def load_resized(model: nn.Module, tensors: Mapping[str, Tensor], resized_prefixes: tuple[str, ...]) -> None:
    """Copy parameters and buffers, of any size where names begin like that. Raises KeyError for a missing or unknown
    name, ValueError where shapes or types do not fit."""
    own = model.state_dict()
    strange = sorted(own.keys() ^ tensors.keys())
    if strange:
        raise KeyError(f"tensor {strange[0]!r} is missing, or unknown")
    for name, tensor in tensors.items():
        owner, _, attribute = name.rpartition(".")
        module = model.get_submodule(owner)
        if not name.startswith(resized_prefixes) and tensor.shape != own[name].shape:
            raise ValueError(f"tensor {name!r} has shape {list(tensor.shape)}, not {list(own[name].shape)}")
        if tensor.ndim != own[name].ndim or tensor.dtype != own[name].dtype or not tensor.numel():
            raise ValueError(f"tensor {name!r} is {tensor.dtype} of shape {list(tensor.shape)}")
        copy = tensor.to(own[name].device, copy=True)
        setattr(module, attribute, copy if attribute in module._buffers else nn.Parameter(copy))


def refuse_uneven(field: VolumeField) -> None:
    """Raise ValueError unless all of the field is of one resolution."""
    sides = field.sides
    if not FEWEST_NODES <= min(sides) <= max(sides) <= MOST_NODES:
        raise ValueError(f"a grid of {sides} nodes; there must be {FEWEST_NODES} to {MOST_NODES} along each axis")
    with torch.device("meta"):
        wanted = {name: tuple(t.shape) for name, t in field.outline(sides).items()}
    for name, tensor in field.named_parameters():
        if tuple(tensor.shape) != wanted[name]:
            raise ValueError(f"tensor 'field.{name}' has shape {list(tensor.shape)}, not {list(wanted[name])}")


def refuse_impossible(tensors: Mapping[str, Tensor]) -> None:
    """Raise ValueError for a box without an inside or without an end, a unit of length that is none, or more cells than
    there may be."""
    for name in ("box", "occupied_box"):
        if tensors[name].shape != (2, 3):
            raise ValueError(f"tensor {name!r} has shape {list(tensors[name].shape)}, not [2, 3]")
        low, high = tensors[name]
        if not bool((low < high).all()):
            raise ValueError(f"tensor {name!r} is a box without an inside")
        if not bool((high - low).isfinite().all()):
            raise ValueError(f"tensor {name!r} is a box of endless sides")
    if not tensors["unit"] > 0:
        raise ValueError("tensor 'unit' is no length")
    x, y, z = tensors["occupied"].shape
    if max(x, y, BITS * z) > MOST_CELLS:
        raise ValueError(f"tensor 'occupied' has bits of {x} x {y} x {BITS * z} cells; {MOST_CELLS} are the most")
