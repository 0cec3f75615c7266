"""The fused reflection shader: planes and parameters in, colours out, nothing kept in between."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight import _kernels
from ringlight.core.camera import Camera
from ringlight.core.kernel_limits import (
    REFLECTION_MAX_FEATURES,
    REFLECTION_MAX_HIDDEN,
    REFLECTION_MAX_LATENTS,
    REFLECTION_MAX_LEVELS,
    REFLECTION_MAX_SIDE,
    REFLECTION_QUAD,
)
from ringlight.core.rendering import KeptTiles, TileGradients
from ringlight.core.triton_kernels import runs_triton
from ringlight.fields.parallax import SMALLEST_HALF_CHORD_SQUARED
from ringlight.shade.covered import FAINTEST_SHADED, SHORTEST_NORMAL
from ringlight.shade.reflection_settings import ReflectionSettings
from ringlight.shade.tile_order import in_drawn_blocks, planes_from_tiles, tiles_from_planes

Planes = list[Float[Tensor, "_ H W"]]
"""What was blended, see :func:`planes_of`."""


def kernel_takes(settings: ReflectionSettings, *tensors: Tensor) -> bool:
    """Whether the kernel can do it: float32 on the CPU, no ring, features in fours, and no size beyond its limits."""
    fits = (
        settings.ring == "none"
        and settings.axis_nodes <= REFLECTION_MAX_SIDE
        and settings.hidden <= REFLECTION_MAX_HIDDEN
        and settings.latents <= REFLECTION_MAX_LATENTS
        and max(settings.sides) <= REFLECTION_MAX_SIDE
    )
    fits = fits and settings.features <= REFLECTION_MAX_FEATURES and settings.features % REFLECTION_QUAD == 0
    fits = fits and len(settings.sides) <= REFLECTION_MAX_LEVELS
    return fits and {(tensor.dtype, tensor.device.type) for tensor in tensors} == {(torch.float32, "cpu")}


MOST_FACTORS = 64
"""Nodes of an axis times features of a map, each rounded up to a power of two, that Triton's way back of a block of
pixels can hold: with four times as many it spills 1.9 KB a thread."""


def fits_triton(settings: ReflectionSettings, *tensors: Tensor) -> bool:
    """Whether Triton's kernels take it: float32 on one GPU, no ring, no gradient of the depth, few enough factors."""
    factors = math.prod(1 << (size - 1).bit_length() for size in (max(settings.axis_nodes, 1), settings.features))
    fits = settings.ring == "none" and not settings.depth_gradient and factors <= MOST_FACTORS
    return fits and runs_triton(*tensors)


def reads_depth(settings: ReflectionSettings) -> bool:
    """Whether reflections depend on where a surface is."""
    return settings.parallax or settings.axis_nodes > 0 or settings.ring != "none"


@dataclass(frozen=True)
class ReflectionJob:
    """One view to shade, without what has a gradient; ``depth`` says whether blended depth is read."""

    shape: _kernels.ReflectionShape
    view: _kernels.ReflectionView
    depth: bool
    depth_gradient: bool
    gradient_share: float


def reflection_job(
    settings: ReflectionSettings, camera: Camera, background: Float[Tensor, "3"], box: Float[Tensor, "2 3"]
) -> ReflectionJob:
    """What the kernel is told; the frame is that of ``ReflectionShader``, the box's longest side is [-1, 1]."""
    depth = reads_depth(settings)
    depth_gradient = settings.depth_gradient and depth
    shape = _kernels.ReflectionShape(
        hidden=settings.hidden,
        layers=settings.hidden_layers + 1,
        latents=settings.latents,
        shells=settings.shells,
        features=settings.features,
        sides=settings.sides,
        parallax=settings.parallax,
        direction=settings.raw_direction,
        depth_gradient=depth_gradient,
        axis_nodes=settings.axis_nodes,
    )
    box, background = (tensor.detach().float().contiguous() for tensor in (box, background))
    view = _kernels.ReflectionView(
        camera=camera.native,
        box=box,
        background=background,
        faintest=FAINTEST_SHADED,
        shortest_normal=SHORTEST_NORMAL,
        smallest_chord=SMALLEST_HALF_CHORD_SQUARED,
    )
    return ReflectionJob(shape, view, depth, depth_gradient, settings.gradient_share)


def planes_of(job: ReflectionJob, image: Float[Tensor, "H W C"], alpha: Float[Tensor, "H W 1"]) -> Planes:
    """The blended planes in the kernel's order: rgb, normal, latents, alpha and, where it is read, depth.

    ``image`` holds them side by side, without alpha, in the order of ``ReflectionShader.needs``.
    """
    planar, depth_width = image.permute(2, 0, 1), [1] if job.depth else []
    latents = len(planar) - 6 - len(depth_width)
    rgb, normal, latent_planes, *depth = planar.split([3, 3, latents, *depth_width])
    planes = [rgb, normal, latent_planes, alpha.permute(2, 0, 1), *depth]
    return [plane.contiguous() for plane in planes]


def shaded_planes(job: ReflectionJob, planes: Planes, parameters: Sequence[Tensor]) -> Float[Tensor, "H W 3"]:
    """The kernel's picture, planar in memory; ``planes`` as :func:`planes_of` has them."""
    color = torch.empty_like(planes[0])
    _kernels.reflection_forward(job.shape, parameters, job.view, planes, color)
    return color.permute(1, 2, 0)


def tile_gradients(
    job: ReflectionJob,
    tiles: KeptTiles,
    parameters: Sequence[Tensor],
    grad_color: Float[Tensor, "H W 3"],
    gradients: Sequence[Tensor],
) -> TileGradients:
    """Gradients of kept tiles; without the depth where that has no gradient. Fills in those of the parameters."""
    blocks, depth, pixels = tiles.values.shape
    wanted = depth - (job.depth and not job.depth_gradient)
    found = tiles.room[: blocks * wanted * pixels].view(blocks, wanted, pixels)
    drawn = torch.empty(blocks, dtype=torch.int32)
    _kernels.reflection_backward(
        job.shape, parameters, job.view, tiles.values, grad_color.permute(2, 0, 1).contiguous(), job.gradient_share,
        gradients, found, drawn,
    )  # fmt: skip
    return found, drawn


def plane_gradients(
    job: ReflectionJob,
    image: Float[Tensor, "H W C"],
    alpha: Float[Tensor, "H W 1"],
    parameters: Sequence[Tensor],
    grad_color: Float[Tensor, "H W 3"],
    gradients: Sequence[Tensor],
) -> tuple[Float[Tensor, "C H W"], Float[Tensor, "1 H W"]]:
    """The same of a whole picture, with the same bits: of its channels side by side, and of alpha."""
    values = tiles_from_planes(torch.cat([image, alpha], -1).permute(2, 0, 1))
    tiles = KeptTiles(values, values.new_empty(values.numel()))
    found, drawn = tile_gradients(job, tiles, parameters, grad_color, gradients)
    found[:, 3:] = torch.where(in_drawn_blocks(drawn), found[:, 3:], 0.0)
    planes = planes_from_tiles(found, *image.shape[:2])
    blended, grad_alpha = planes[:-1], planes[-1:]
    if job.depth and not job.depth_gradient:
        blended = torch.cat([blended, torch.zeros_like(grad_alpha)])
    return blended, grad_alpha
