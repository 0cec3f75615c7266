"""Which tensor of a model is packed how, by its name; and a whole model's tensors packed and back.

Columns of the table are packed by what they hold, shared networks and tables by rows of bytes. What the plan does not
know is kept: a tensor of whole numbers, a small one, one that holds a number that is not finite. The plan decides when
a file is written; a reader goes by what the file says.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
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
    LARGEST_HALF,
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

CODEBOOKS = ("codebook", "codebook8")

HALVES = ("half", *CODEBOOKS)
"""Packings of half floats, which are infinite beyond LARGEST_HALF."""

Plan = tuple[tuple[str, str], ...]
"""Name patterns and packings; the first that fits counts. Positions are decided by :func:`_positions`."""

PLAN: Plan = (
    ("columns.log_scales", "fixed10"),
    ("columns.quats", "quaternions32"),
    ("columns.opacity_logits", "share8"),
    ("columns.base", "share8"),
    ("columns.latents", "fixed8"),
    ("columns.basis_weights", "fixed16"),
    ("columns.normals", "directions20"),
    ("columns.sh_dc", "fixed12"),
    ("columns.sh_rest", "fixed8"),
    ("columns.reflection_logits", "share8"),
    ("columns.opacity_rest", "fixed8"),
    ("columns.tint_logits", "share8"),
    ("columns.roughness_logits", "share8"),
    ("columns.normal_residuals", "fixed10"),
    ("columns.*", "half"),
    ("shader.texels", "share8"),
    ("color.light.texels", "share8"),
    ("color.*", "rows8"),
    ("shader.*", "rows8"),
)
"""What 'ringlight compress' does."""

MEANS, SCALES, WEIGHTS = "columns.means", "columns.log_scales", "columns.basis_weights"

BASES = ("color.basis", "color.varying.basis")
"""Functions of the direction that the weights mix to colours, of either kind of model."""

OPACITY_BASES = ("color.opacity_basis", "color.varying.opacity_basis")
"""Those that they mix to logits of opacity."""

MEAN_SLOPE = 1 / 6
"""Of a sigmoid, over all opacities alike: so much a logit moves an opacity, and a colour in front of black."""

COEFFICIENT_STEP, COARSE_COEFFICIENT_STEP = 1 / 32, 1 / 16
"""Of a weight, in the length of the coefficients that it adds. Half of the first moves a coefficient by a few
thousandths, as 8 bit move a base colour."""

FEWEST_ROWS8, FEWEST_PACKED = 1024, 64
"""Shared tensors of fewer values than the first are half floats, of fewer than the second stay as they are: biases and
single numbers save nothing and may matter much."""

SHIFT = 0.01
"""Positions may move by this share of a usual Gaussian's largest standard deviation, which changes what it adds to a
pixel by 0.6 % of its peak at most. 16 bits do in scenes of one object, unbounded scenes take 24."""

COARSE: Plan = ((SCALES, "fixed8"), ("columns.quats", "turns24"))
"""Of what is rounded further."""

COARSE_STEP, SMALL = 0.05, 0.1
"""The step of coarse positions in standard deviations: along the middle axis of a Gaussian than which this share of all
is smaller."""


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
        chosen = _chosen(name, tensor, tensors.get(SCALES), plan)
        if chosen is None:
            stored[name] = tensor
            continue
        step = (steps or {}).get(name)
        step = _step(name, tensors, coarse) if step is None else step
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
    fitting = {n: t for n, t in tensors.items() if _chosen(n, t, scales, plan) not in HALVES or _are_halves(t)}
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


def _chosen(name: str, tensor: Tensor, log_scales: Tensor | None, patterns: Plan) -> str | None:
    """The packing of a tensor; None if it is kept."""
    if tensor.dtype != torch.float32 or not bool(tensor.isfinite().all()):
        return None
    if name == MEANS:
        return _positions(tensor, log_scales)
    plan = next((packing for pattern, packing in patterns if fnmatchcase(name, pattern)), None)
    if plan == "rows8" and tensor.numel() < FEWEST_ROWS8:
        plan = "half" if tensor.numel() >= FEWEST_PACKED else None
    if plan in CODEBOOKS and not tensor.numel():
        return None
    if plan in HALVES and tensor.numel() and tensor.abs().amax() > LARGEST_HALF:
        return None
    return plan


def _step(name: str, tensors: Mapping[str, Tensor], coarse: bool) -> Float[Tensor, "C"] | None:
    """The step of each column of a tensor that is packed in steps of its own; None for all others."""
    if name == WEIGHTS:
        return _step_of_weights(tensors, COARSE_COEFFICIENT_STEP if coarse else COEFFICIENT_STEP)
    if name == MEANS and coarse:
        return _step_of_positions(tensors)
    return None


def _step_of_weights(tensors: Mapping[str, Tensor], coefficient: float) -> Float[Tensor, "K"] | None:
    """None where the basis is not there, or of another size."""
    basis = next((tensors[name].detach().cpu().double() for name in BASES if name in tensors), None)
    if basis is None or tensors[WEIGHTS].dim() != 2 or len(basis) != tensors[WEIGHTS].shape[1]:
        return None
    mixed = basis.flatten(1)
    opacities = next((tensors[name] for name in OPACITY_BASES if name in tensors), None)
    if opacities is not None and len(opacities) == len(mixed):
        mixed = torch.cat([mixed, MEAN_SLOPE * opacities.detach().cpu().double().flatten(1)], 1)
    return coefficient / mixed.norm(dim=1).clamp_min(SHORTEST_FUNCTION)


def _step_of_positions(tensors: Mapping[str, Tensor]) -> Float[Tensor, "3"] | None:
    """None where there are no scales, or where it is finer than 16 bits are."""
    means, log_scales = tensors[MEANS].detach().cpu().double(), tensors.get(SCALES)
    if log_scales is None or log_scales.shape != means.shape or not len(means) or not bool(log_scales.isfinite().all()):
        return None
    middle = log_scales.detach().cpu().double().sort(-1).values[:, 1]
    small = middle.kthvalue(max(int(SMALL * len(middle)), 1)).values.exp()
    step, reach = COARSE_STEP * small, (means.amax(0) - means.amin(0)).amax()
    return step.expand(3).clone() if step > reach / 0xFFFF else None


def _in_steps(values: Float[Tensor, "N C"], step: Float[Tensor, "C"]) -> Parts | None:
    """None where two bytes are too few for it."""
    try:
        return pack_in_steps(values.detach().cpu(), step)
    except ValueError:
        return None


SHORTEST_FUNCTION = 1e-3
"""Length of the coefficients of a shared function; what is shorter shows nothing."""


def _positions(means: Float[Tensor, "N 3"], log_scales: Tensor | None) -> str:
    """Sixteen bits where half a step is small beside the Gaussians, else twenty-four."""
    if log_scales is None or log_scales.shape != means.shape or not len(means):
        return "fixed24"
    usual = float(log_scales.detach().amax(-1).median().exp())
    reach = float((means.detach().double().amax(0) - means.detach().double().amin(0)).amax())
    return "fixed16" if reach / (2 * 0xFFFF) <= SHIFT * usual else "fixed24"
