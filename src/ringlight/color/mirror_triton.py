"""What a mirror emits as Triton kernels: normals turned to the camera, latents and depth, and their gradients.

One launch each way. The reference is ``mirror_channels_reference``.
"""

import torch
import triton
import triton.language as tl
from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.triton_kernels import VARYING

BLOCK = 256
"""Gaussians a program."""


@triton.jit
def _facing(means, normals, row, mask, from_x, from_y, from_z, flip_below, shortest):
    """The unit normal, turned to the camera; the stored one's inverse length, and by what it was multiplied."""
    x = tl.load(normals + row * 3, mask=mask, other=1.0)
    y = tl.load(normals + row * 3 + 1, mask=mask, other=0.0)
    z = tl.load(normals + row * 3 + 2, mask=mask, other=0.0)
    squared = x * x + y * y + z * z
    inverse = 1.0 / tl.sqrt(tl.maximum(squared, shortest))
    to_x = from_x - tl.load(means + row * 3, mask=mask, other=0.0)
    to_y = from_y - tl.load(means + row * 3 + 1, mask=mask, other=0.0)
    to_z = from_z - tl.load(means + row * 3 + 2, mask=mask, other=0.0)
    near = 1.0 / tl.sqrt(tl.maximum(to_x * to_x + to_y * to_y + to_z * to_z, shortest))
    cosine = (x * to_x + y * to_y + z * to_z) * inverse * near
    scale = tl.where(cosine >= flip_below, inverse, -inverse)
    return x * scale, y * scale, z * scale, scale, squared


@triton.jit(do_not_specialize=VARYING)
def _surface(
    means, normals, latents, channels, count, stride, from_x, from_y, from_z, z_x, z_y, z_z, z_0,
    flip_below, shortest, LATENTS: tl.constexpr, B: tl.constexpr,
):  # fmt: skip
    """Writes normal, latents and depth behind the first three of ``stride`` channels."""
    row = tl.program_id(0) * B + tl.arange(0, B)
    mask = row < count
    into = channels + row * stride
    x, y, z, _, _ = _facing(means, normals, row, mask, from_x, from_y, from_z, flip_below, shortest)
    tl.store(into + 3, x, mask=mask)
    tl.store(into + 4, y, mask=mask)
    tl.store(into + 5, z, mask=mask)
    for i in tl.static_range(LATENTS):
        tl.store(into + 6 + i, tl.load(latents + row * LATENTS + i, mask=mask, other=0.0), mask=mask)
    depth = z_x * tl.load(means + row * 3, mask=mask, other=0.0) + z_0
    depth += z_y * tl.load(means + row * 3 + 1, mask=mask, other=0.0)
    depth += z_z * tl.load(means + row * 3 + 2, mask=mask, other=0.0)
    tl.store(into + 6 + LATENTS, depth, mask=mask)


@triton.jit(do_not_specialize=VARYING)
def _surface_gradient(
    means, normals, upstream, grad_means, grad_normals, grad_latents,
    count, stride, from_x, from_y, from_z, z_x, z_y, z_z, flip_below, shortest,
    LATENTS: tl.constexpr, B: tl.constexpr,
):  # fmt: skip
    """Adds the depth's part to ``grad_means``. A normal too short to be stretched to a unit has a slope of its own."""
    row = tl.program_id(0) * B + tl.arange(0, B)
    mask = row < count
    given = upstream + row * stride
    x, y, z, scale, squared = _facing(means, normals, row, mask, from_x, from_y, from_z, flip_below, shortest)
    by_x = tl.load(given + 3, mask=mask, other=0.0)
    by_y = tl.load(given + 4, mask=mask, other=0.0)
    by_z = tl.load(given + 5, mask=mask, other=0.0)
    along = tl.where(squared > shortest, by_x * x + by_y * y + by_z * z, 0.0)
    tl.store(grad_normals + row * 3, (by_x - along * x) * scale, mask=mask)
    tl.store(grad_normals + row * 3 + 1, (by_y - along * y) * scale, mask=mask)
    tl.store(grad_normals + row * 3 + 2, (by_z - along * z) * scale, mask=mask)
    for i in tl.static_range(LATENTS):
        by_latent = tl.load(given + 6 + i, mask=mask, other=0.0)
        tl.store(grad_latents + row * LATENTS + i, by_latent, mask=mask)
    by_depth = tl.load(given + 6 + LATENTS, mask=mask, other=0.0)
    place = grad_means + row * 3
    tl.store(place, tl.load(place, mask=mask, other=0.0) + by_depth * z_x, mask=mask)
    tl.store(place + 1, tl.load(place + 1, mask=mask, other=0.0) + by_depth * z_y, mask=mask)
    tl.store(place + 2, tl.load(place + 2, mask=mask, other=0.0) + by_depth * z_z, mask=mask)


def write_surface(
    means: Float[Tensor, "N 3"],
    normals: Float[Tensor, "N 3"],
    latents: Float[Tensor, "N L"],
    camera: Camera,
    flip_below: float,
    smallest_length: float,
    channels: Float[Tensor, "N C"],
) -> None:
    """Into ``channels``, behind "rgb" 3: "normal" 3, "latents" L and "depth" 1."""
    count = len(means)
    if count:
        _surface[(triton.cdiv(count, BLOCK),)](
            means, normals, latents, channels, count, channels.shape[1],
            *camera.position.tolist(), *camera.pose_numbers[8:], flip_below, smallest_length**2,
            latents.shape[1], BLOCK,
        )  # fmt: skip


def surface_gradients(
    means: Float[Tensor, "N 3"],
    normals: Float[Tensor, "N 3"],
    latents: Float[Tensor, "N L"],
    camera: Camera,
    flip_below: float,
    smallest_length: float,
    upstream: Float[Tensor, "N C"],
    grad_means: Float[Tensor, "N 3"],
) -> tuple[Float[Tensor, "N 3"], Float[Tensor, "N L"]]:
    """By normals and latents; what the depth says of the means is added to ``grad_means``."""
    count, by_normals, by_latents = len(means), torch.empty_like(normals), torch.empty_like(latents)
    if count:
        _surface_gradient[(triton.cdiv(count, BLOCK),)](
            means, normals, upstream, grad_means, by_normals, by_latents, count, upstream.shape[1],
            *camera.position.tolist(), *camera.pose_numbers[8:11], flip_below, smallest_length**2,
            latents.shape[1], BLOCK,
        )  # fmt: skip
    return by_normals, by_latents
