"""The photometric loss and its gradient as Triton kernels, for images on a GPU: four passes, whatever the size.

The windowed means are separable, so each is one pass along rows and one along columns. SSIM's gradient needs three
more blurred maps: dS/dmean, dS/d(mean of squares) and dS/d(mean of products); what depends on the photograph alone is
blurred once, when it becomes a target. The reference is ``photometric_reference``.
"""

import torch
import triton
import triton.language as tl
from jaxtyping import Float
from torch import Tensor

BLOCK = 1024
"""Pixels a program: one of each channel and pass."""


@triton.jit
def _along_rows(
    image, target, weights, maps, height, width, step_y, step_x, step_c, REACH: tl.constexpr, SIZE: tl.constexpr
):
    """maps[0..2]: sums along the row of w x, w x x and w x y."""
    pixel = tl.program_id(0) * SIZE + tl.arange(0, SIZE)
    channel = tl.program_id(1)
    count = height * width
    y, x = pixel // width, pixel % width
    mean = tl.zeros((SIZE,), tl.float32)
    square = tl.zeros((SIZE,), tl.float32)
    product = tl.zeros((SIZE,), tl.float32)
    for tap in range(2 * REACH + 1):
        at = x + tap - REACH
        inside = (pixel < count) & (at >= 0) & (at < width)
        weight = tl.load(weights + tap)
        ours = tl.load(image + channel * step_c + y * step_y + at * step_x, mask=inside, other=0.0)
        theirs = tl.load(target + channel * count + pixel + tap - REACH, mask=inside, other=0.0)
        mean += weight * ours
        square += weight * ours * ours
        product += weight * ours * theirs
    to = maps + channel * count + pixel
    tl.store(to, mean, mask=pixel < count)
    tl.store(to + 3 * count, square, mask=pixel < count)
    tl.store(to + 6 * count, product, mask=pixel < count)


@triton.jit
def _blurred_down(at, weights, count, y, height, width, valid, REACH: tl.constexpr, SIZE: tl.constexpr):
    """Blurs along columns, of these pixels, of the three maps that begin ``at`` them, three planes apart."""
    mean = tl.zeros((SIZE,), tl.float32)
    square = tl.zeros((SIZE,), tl.float32)
    product = tl.zeros((SIZE,), tl.float32)
    for tap in range(2 * REACH + 1):
        row = y + tap - REACH
        inside = valid & (row >= 0) & (row < height)
        weight = tl.load(weights + tap)
        away = (tap - REACH) * width
        mean += weight * tl.load(at + away, mask=inside, other=0.0)
        square += weight * tl.load(at + 3 * count + away, mask=inside, other=0.0)
        product += weight * tl.load(at + 6 * count + away, mask=inside, other=0.0)
    return mean, square, product


@triton.jit
def _compare(
    image, target, blur, square_blur, weights, maps, slopes, sums, height, width, step_y, step_x, step_c,
    pixel_weight, ssim_weight, SQUARED: tl.constexpr, C1: tl.constexpr, C2: tl.constexpr,
    REACH: tl.constexpr, SIZE: tl.constexpr,
):  # fmt: skip
    """Blurs along columns, SSIM, its slopes by the three means, and each program's share of the loss."""
    pixel = tl.program_id(0) * SIZE + tl.arange(0, SIZE)
    channel = tl.program_id(1)
    count = height * width
    y, x = pixel // width, pixel % width
    valid = pixel < count
    at = maps + channel * count + pixel
    mean, square, product = _blurred_down(at, weights, count, y, height, width, valid, REACH, SIZE)
    other = tl.load(blur + channel * count + pixel, mask=valid, other=0.0)
    other_square = tl.load(square_blur + channel * count + pixel, mask=valid, other=0.0)
    over1 = 2 * mean * other + C1
    over2 = 2 * (product - mean * other) + C2
    under1 = mean * mean + other * other + C1
    under2 = (square - mean * mean) + (other_square - other * other) + C2
    similarity = over1 * over2 / (under1 * under2)
    grad_product = 2 * over1 / (under1 * under2)
    grad_square = -similarity / under2
    grad_mean = 2 * other * over2 / (under1 * under2) - 2 * mean * similarity / under1
    grad_mean += -2 * mean * grad_square - other * grad_product
    to = slopes + channel * count + pixel
    tl.store(to, grad_mean, mask=valid)
    tl.store(to + 3 * count, grad_square, mask=valid)
    tl.store(to + 6 * count, grad_product, mask=valid)
    ours = tl.load(image + channel * step_c + y * step_y + x * step_x, mask=valid, other=0.0)
    theirs = tl.load(target + channel * count + pixel, mask=valid, other=0.0)
    difference = ours - theirs
    off = difference * difference if SQUARED else tl.abs(difference)
    loss = pixel_weight * off + ssim_weight * (1 - similarity)
    program = channel * tl.num_programs(0) + tl.program_id(0)
    tl.store(sums + program, tl.sum(tl.where(valid, loss, 0.0)))


@triton.jit
def _slopes_along_rows(slopes, weights, maps, height, width, REACH: tl.constexpr, SIZE: tl.constexpr):
    """The same blur of three maps; the window is symmetric, so the way back is the way there."""
    pixel = tl.program_id(0) * SIZE + tl.arange(0, SIZE)
    plane = tl.program_id(1)
    count = height * width
    x = pixel % width
    total = tl.zeros((SIZE,), tl.float32)
    for tap in range(2 * REACH + 1):
        at = x + tap - REACH
        inside = (pixel < count) & (at >= 0) & (at < width)
        total += tl.load(weights + tap) * tl.load(slopes + plane * count + pixel + tap - REACH, mask=inside, other=0.0)
    tl.store(maps + plane * count + pixel, total, mask=pixel < count)


@triton.jit
def _gradient(
    image, target, weights, maps, gradient, height, width, step_y, step_x, step_c,
    pixel_weight, ssim_weight, SQUARED: tl.constexpr, REACH: tl.constexpr, SIZE: tl.constexpr,
):  # fmt: skip
    """Slopes blurred along columns too, and what they mean for each pixel; ``gradient`` lies as ``image`` does."""
    pixel = tl.program_id(0) * SIZE + tl.arange(0, SIZE)
    channel = tl.program_id(1)
    count = height * width
    y, x = pixel // width, pixel % width
    valid = pixel < count
    at = maps + channel * count + pixel
    grad_mean, grad_square, grad_product = _blurred_down(at, weights, count, y, height, width, valid, REACH, SIZE)
    place = channel * step_c + y * step_y + x * step_x
    ours = tl.load(image + place, mask=valid, other=0.0)
    theirs = tl.load(target + channel * count + pixel, mask=valid, other=0.0)
    difference = ours - theirs
    if SQUARED:
        slope = 2 * difference
    else:
        slope = tl.where(difference > 0, 1.0, tl.where(difference < 0, -1.0, 0.0))
    total = pixel_weight * slope - ssim_weight * (grad_mean + 2 * ours * grad_square + theirs * grad_product)
    tl.store(gradient + place, total, mask=valid)


def photometric_by_triton(
    color: Float[Tensor, "H W 3"],
    target: Float[Tensor, "3 H W"],
    blur: Float[Tensor, "3 H W"],
    square_blur: Float[Tensor, "3 H W"],
    window: Float[Tensor, "11"],
    constants: tuple[float, float],
    pixel_weight: float,
    ssim_weight: float,
    squared: bool,
) -> tuple[Float[Tensor, ""], Float[Tensor, "H W 3"]]:
    """Loss and gradient; the latter in memory of the same form as ``color``'s, or contiguous if that has gaps.

    ``constants`` are SSIM's C1 and C2. Partial sums are added by torch, in the same order each time.
    """
    if not (color.is_contiguous() or color.permute(2, 0, 1).is_contiguous()):
        color = color.contiguous()  # channels of a wider image: a gradient of the same strides would be as wide
    height, width = color.shape[:2]
    count = 3 * height * width
    reach = len(window) // 2
    maps = color.new_empty(2, 9, height, width)
    blurred, slopes = maps.unbind()
    gradient = torch.empty_like(color)
    blocks = triton.cdiv(height * width, BLOCK)
    sums = color.new_empty(3 * blocks)
    steps = color.stride()
    shares = (pixel_weight / count, ssim_weight / count)
    sizes = {"REACH": reach, "SIZE": BLOCK}
    _along_rows[(blocks, 3)](color, target, window, blurred, height, width, *steps, **sizes)
    _compare[(blocks, 3)](
        color, target, blur, square_blur, window, blurred, slopes, sums, height, width, *steps, *shares,
        SQUARED=squared, C1=constants[0], C2=constants[1], **sizes,
    )  # fmt: skip
    _slopes_along_rows[(blocks, 9)](slopes, window, blurred, height, width, **sizes)
    _gradient[(blocks, 3)](
        color, target, window, blurred, gradient, height, width, *steps, *shares, SQUARED=squared, **sizes
    )
    return sums.sum(), gradient
