"""Ellipsoids whose shortest axis is a normal, made ready for packing: which axis that is shall survive rounding."""

from collections.abc import Mapping

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.files.packed import Packed, pack_tensors
from ringlight.files.packing_plan import PLAN

SCALES, QUATS = "columns.log_scales", "columns.quats"

AXES_PLAN = ((SCALES, "fixed12"), (QUATS, "fixed12"), ("columns.opacity_logits", "fixed12"))
"""What mirrors by normals need: with 10 bits of scales and rotations a chrome toaster of 3dgs-dr was 53.7 dB from the
model, with 12 58.7. Faint Gaussians show what lies behind them: a model of 60 steps was 52.5 dB away by 8 bits of its
opacities alone, and is 73 with 12."""

BITS = 12

THIRD_OF_A_TURN = (0.5, 0.5, 0.5, 0.5)
"""The rotation that takes x to y, y to z and z to x, as a quaternion wxyz."""


MARGIN = 1.01
"""For roundings of what is computed here, and of the range, which grows by what is shortened."""


def pack_with_axes(tensors: Mapping[str, Tensor]) -> Packed:
    """Of a model whose colours go by the axes of its Gaussians: an axis that another took the place of would mirror
    elsewhere."""
    return pack_tensors(ready_axes(tensors), (*AXES_PLAN, *PLAN))


def ready_axes(tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """The same ellipsoids, unit quaternions, and shortest axes that stay so when packed by AXES_PLAN."""
    log_scales, quats = shortest_first(tensors[SCALES], tensors[QUATS])
    unit = torch.nn.functional.normalize(quats, dim=-1)
    return dict(tensors) | {SCALES: told_apart(log_scales, BITS), QUATS: unit}


def shortest_first(
    log_scales: Float[Tensor, "N 3"], quats: Float[Tensor, "N 4"]
) -> tuple[Float[Tensor, "N 3"], Float[Tensor, "N 4"]]:
    """The same ellipsoids with their axes counted from the shortest on, in the same order round; signs are kept."""
    shortest = log_scales.argmin(-1)
    order = (shortest[:, None] + torch.arange(3, device=shortest.device)) % 3
    turned = quats
    for turns in (1, 2):
        turned = torch.where((shortest >= turns)[:, None], _third_of_a_turn(turned), turned)
    return log_scales.gather(1, order), turned


def _third_of_a_turn(quats: Float[Tensor, "N 4"]) -> Float[Tensor, "N 4"]:
    """Each quaternion times THIRD_OF_A_TURN: its second axis becomes the first."""
    w, x, y, z = quats.unbind(-1)
    a, b, c, d = THIRD_OF_A_TURN
    return torch.stack(
        [
            a * w - b * x - c * y - d * z,
            b * w + a * x + d * y - c * z,
            c * w - d * x + a * y + b * z,
            d * w + c * x - b * y + a * z,
        ],
        -1,
    )


def told_apart(log_scales: Float[Tensor, "N 3"], bits: int) -> Float[Tensor, "N 3"]:
    """Axes of :func:`shortest_first`, the first shorter than the others by more than ``bits`` of each column's range
    lose: by a step at most it is shortened where it is not."""
    steps = (
        (log_scales.amax(0) - log_scales.amin(0)) / ((1 << bits) - 1) if len(log_scales) else log_scales.new_zeros(3)
    )
    lost = (steps[0] + steps[1:].amax()) / 2
    first = torch.minimum(log_scales[:, 0], log_scales[:, 1:].amin(-1) - lost * MARGIN)
    return torch.cat([first[:, None], log_scales[:, 1:]], -1)
