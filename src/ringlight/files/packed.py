"""A whole model's tensors packed and back, by the plan of ``files/packing_plan.py``."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.stages import counted
from ringlight.errors import ModelFileError
from ringlight.files.pack_codebook import pack_codebook, pack_codebook8, unpack_codebook, unpack_codebook8
from ringlight.files.pack_directions import (
    pack_directions,
    pack_quaternions,
    pack_turns,
    unpack_directions,
    unpack_quaternions,
    unpack_turns,
)
from ringlight.files.pack_numbers import (
    Parts,
    pack_fine,
    pack_fixed,
    pack_half,
    pack_in_steps,
    pack_rows,
    pack_share,
    unpack_fine,
    unpack_fixed,
    unpack_half,
    unpack_rows,
    unpack_share,
)
from ringlight.files.packing_plan import COARSE, HALVES, PLAN, SCALES, Plan, chosen_packing, chosen_step

SEPARATOR = ":"
"""Between a tensor's name and the name of its part, as in "columns.base:share"; occurs in no tensor's name."""


@dataclass(frozen=True)
class Packing:
    """One way to store a float32 tensor in fewer bytes."""

    pack: Callable[[Tensor], Parts]
    unpack: Callable[[Parts], Tensor]


PACKINGS = {
    "half": Packing(pack_half, unpack_half),
    "rows8": Packing(pack_rows, unpack_rows),
    "fixed8": Packing(partial(pack_fixed, width=1), unpack_fixed),
    "fixed10": Packing(partial(pack_fine, bits=2), partial(unpack_fine, bits=2)),
    "fixed12": Packing(partial(pack_fine, bits=4), partial(unpack_fine, bits=4)),
    "fixed16": Packing(partial(pack_fixed, width=2), unpack_fixed),
    "fixed24": Packing(partial(pack_fixed, width=3), unpack_fixed),
    "share8": Packing(pack_share, unpack_share),
    "directions20": Packing(pack_directions, unpack_directions),
    "quaternions32": Packing(pack_quaternions, unpack_quaternions),
    "turns24": Packing(pack_turns, unpack_turns),
    "codebook": Packing(pack_codebook, unpack_codebook),
    "codebook8": Packing(pack_codebook8, unpack_codebook8),
}
"""By the names that model files use; a name never changes its meaning."""


@dataclass(frozen=True)
class Packed:
    """``tensors`` as stored: parts "NAME:PART", and by their own name those that are kept; ``packing`` by name."""

    tensors: dict[str, Tensor]
    packing: dict[str, str]


def pack_tensors(
    tensors: Mapping[str, Tensor],
    plan: Plan = PLAN,
    coarse: bool = False,
    steps: Mapping[str, Float[Tensor, "C"]] | None = None,
) -> Packed:
    """Every tensor by the plan; ``coarse``, scales, rotations, positions and weights are rounded further, which takes
    fewer bytes once they are deflated. Columns of the tensors that ``steps`` names are rounded to these."""
    if coarse:
        plan = (*COARSE, *plan)
    stored: dict[str, Tensor] = {}
    packing: dict[str, str] = {}
    for name, tensor in counted("packing", list(tensors.items())):
        chosen = chosen_packing(name, tensor, tensors.get(SCALES), plan)
        if chosen is None:
            stored[name] = tensor
            continue
        step = (steps or {}).get(name)
        step = chosen_step(name, tensors, coarse) if step is None else step
        parts = None if step is None else _in_steps(tensor, step)
        if parts is not None:
            chosen = f"fixed{8 * parts['codes'].shape[-1]}"
        packing[name] = chosen
        parts = parts or PACKINGS[chosen].pack(tensor.detach().cpu())
        stored |= {f"{name}{SEPARATOR}{part}": value for part, value in parts.items()}
    return Packed(stored, packing)


def pack_exactly(tensors: Mapping[str, Tensor], plan: Plan) -> Packed:
    """By the plan every tensor that comes back with the same bits; the others are kept."""
    scales = tensors.get(SCALES)
    # Whether half floats hold a tensor is found out first: to find rows that occur twice they are sorted.
    fitting = {n: t for n, t in tensors.items() if chosen_packing(n, t, scales, plan) not in HALVES or _are_halves(t)}
    with_scales = fitting if scales is None else fitting | {SCALES: scales}
    tried = pack_tensors(with_scales, plan)
    back = unpack_tensors(tried)
    exact = {name for name in tried.packing if torch.equal(back[name], tensors[name].detach().cpu())}
    stored = {name: tensor for name, tensor in tensors.items() if name not in exact}
    stored |= {name: t for name, t in tried.tensors.items() if name.partition(SEPARATOR)[0] in exact}
    return Packed(stored, {name: tried.packing[name] for name in tried.packing if name in exact})


def _are_halves(tensor: Tensor) -> bool:
    """Whether half floats hold it."""
    return tensor.is_floating_point() and torch.equal(tensor.half().to(tensor.dtype), tensor)


def unpack_tensors(packed: Packed) -> dict[str, Tensor]:
    """Inverse of :func:`pack_tensors` but for rounding, float32. Raises ModelFileError, without a file's name."""
    parts: dict[str, Parts] = {name: {} for name in packed.packing}
    tensors: dict[str, Tensor] = {}
    for stored, tensor in packed.tensors.items():
        name, separator, part = stored.partition(SEPARATOR)
        if not separator:
            tensors[name] = tensor
        elif name in parts:
            parts[name][part] = tensor
        else:
            raise ModelFileError(f"part {stored!r} belongs to no packed tensor")
    for name, chosen in packed.packing.items():
        if chosen not in PACKINGS:
            raise ModelFileError(f"tensor {name!r} is packed in a way that this version does not know ({chosen[:40]})")
        try:
            tensors[name] = PACKINGS[chosen].unpack(parts[name])
        except (KeyError, ValueError, RuntimeError) as error:
            reason = str(error).splitlines()[0]
            raise ModelFileError(f"tensor {name!r} does not fit its packing {chosen} ({reason})") from None
    return tensors


def bytes_stored(packed: Packed, name: str) -> int:
    """Bytes of one tensor as stored, all its parts."""
    return sum(
        tensor.numel() * tensor.element_size()
        for stored, tensor in packed.tensors.items()
        if stored.partition(SEPARATOR)[0] == name
    )


def _in_steps(values: Float[Tensor, "N C"], step: Float[Tensor, "C"]) -> Parts | None:
    """None where two bytes are too few for it."""
    try:
        return pack_in_steps(values.detach().cpu(), step)
    except ValueError:
        return None
