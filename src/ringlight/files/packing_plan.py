"""Which tensor of a model is packed how, and in what steps, by its name.

Columns of the table are packed by what they hold, shared networks and tables by rows of bytes. What the plan does not
know is kept: a tensor of whole numbers, a small one, one that holds a number that is not finite. The plan decides when
a file is written; a reader goes by what the file says.
"""

from collections.abc import Mapping
from fnmatch import fnmatchcase

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.files.pack_codebook import WIDEST_ROW
from ringlight.files.pack_numbers import LARGEST_HALF

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

SHORTEST_FUNCTION = 1e-3
"""Length of the coefficients of a shared function; what is shorter shows nothing."""


def chosen_packing(name: str, tensor: Tensor, log_scales: Tensor | None, patterns: Plan) -> str | None:
    """The packing of a tensor, the first of whose ``patterns`` fits its name; None if it is kept. Positions go by the
    table's ``log_scales`` [N 3], where there are any."""
    if tensor.dtype != torch.float32 or not bool(tensor.isfinite().all()):
        return None
    if name == MEANS:
        return _positions(tensor, log_scales)
    plan = next((packing for pattern, packing in patterns if fnmatchcase(name, pattern)), None)
    if plan == "rows8" and tensor.numel() < FEWEST_ROWS8:
        plan = "half" if tensor.numel() >= FEWEST_PACKED else None
    if plan in CODEBOOKS and not 0 < tensor.numel() <= WIDEST_ROW * len(tensor):
        return None
    if plan in HALVES and tensor.numel() and tensor.abs().amax() > LARGEST_HALF:
        return None
    return plan


def chosen_step(name: str, tensors: Mapping[str, Tensor], coarse: bool) -> Float[Tensor, "C"] | None:
    """The step of each column of a tensor that is packed in steps of its own, weights and, if ``coarse``, positions;
    None for all others."""
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


def _positions(means: Float[Tensor, "N 3"], log_scales: Tensor | None) -> str:
    """Sixteen bits where half a step is small beside the Gaussians, else twenty-four."""
    if log_scales is None or log_scales.shape != means.shape or not len(means):
        return "fixed24"
    usual = float(log_scales.detach().amax(-1).median().exp())
    reach = float((means.detach().double().amax(0) - means.detach().double().amin(0)).amax())
    return "fixed16" if reach / (2 * 0xFFFF) <= SHIFT * usual else "fixed24"
