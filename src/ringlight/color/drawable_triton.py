"""Which Gaussians a rasterizer could draw, by one Triton kernel; the reference is ``drawable``."""

import torch
import triton
import triton.language as tl
from jaxtyping import Bool, Float
from torch import Tensor

from ringlight.core.triton_kernels import VARYING

BLOCK = 512
"""Gaussians a program."""


@triton.jit(do_not_specialize=VARYING)
def _drawable(means, log_scales, logits, view, marks, count, B: tl.constexpr):
    """``view``: rows of the pose 12, focal 2, half size 2, centre less half size 2, steepest slopes 2, reach in sigmas,
    reach in pixels, faintest logit."""
    row = tl.program_id(0) * B + tl.arange(0, B)
    mask = row < count
    x = tl.load(means + row * 3, mask=mask, other=0.0)
    y = tl.load(means + row * 3 + 1, mask=mask, other=0.0)
    z = tl.load(means + row * 3 + 2, mask=mask, other=0.0)
    right = x * tl.load(view) + y * tl.load(view + 1) + z * tl.load(view + 2) + tl.load(view + 3)
    under = x * tl.load(view + 4) + y * tl.load(view + 5) + z * tl.load(view + 6) + tl.load(view + 7)
    depth = x * tl.load(view + 8) + y * tl.load(view + 9) + z * tl.load(view + 10) + tl.load(view + 11)
    focal_x, focal_y = tl.load(view + 12), tl.load(view + 13)
    slope_x, slope_y = right / depth, under / depth
    steepest_x, steepest_y = tl.load(view + 18), tl.load(view + 19)
    flat_x = tl.minimum(tl.maximum(slope_x, -steepest_x), steepest_x)
    flat_y = tl.minimum(tl.maximum(slope_y, -steepest_y), steepest_y)
    spread = focal_x * focal_x * (1 + flat_x * flat_x) + focal_y * focal_y * (1 + flat_y * flat_y)
    a = tl.load(log_scales + row * 3, mask=mask, other=0.0)
    b = tl.load(log_scales + row * 3 + 1, mask=mask, other=0.0)
    c = tl.load(log_scales + row * 3 + 2, mask=mask, other=0.0)
    scale = tl.exp(tl.maximum(tl.maximum(a, b), c))
    reach = tl.load(view + 20) * scale * tl.sqrt(spread) / depth + tl.load(view + 21)
    off_x = tl.abs(focal_x * slope_x + tl.load(view + 16)) - tl.load(view + 14)
    off_y = tl.abs(focal_y * slope_y + tl.load(view + 17)) - tl.load(view + 15)
    strong = tl.load(logits + row, mask=mask, other=0.0) >= tl.load(view + 22)
    tl.store(marks + row, (strong & (depth > 0) & (off_x <= reach) & (off_y <= reach)).to(tl.int8), mask=mask)


@torch.no_grad()
def drawable_by_triton(
    means: Float[Tensor, "N 3"], log_scales: Float[Tensor, "N 3"], opacity_logits: Float[Tensor, "N"], view: list[float]
) -> Bool[Tensor, "N"]:
    """Marks; ``view`` as the kernel has it."""
    marks = torch.empty(len(means), dtype=torch.int8, device=means.device)
    if len(means):
        columns = (column.detach().contiguous() for column in (means, log_scales, opacity_logits))
        numbers = torch.tensor(view, dtype=torch.float32).to(means.device)
        _drawable[(triton.cdiv(len(means), BLOCK),)](*columns, numbers, marks, len(means), BLOCK)
    return marks.bool()
