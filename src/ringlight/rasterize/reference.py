"""The executable specification of blending: pure torch, plain autograd, float32 or float64. Slow.

Alpha blending of 3DGS (Kerbl et al. 2023, equations 2 to 4) with gsplat's cut-offs; every other back end is tested
against this file.
"""

from collections.abc import Mapping

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.utils.checkpoint import checkpoint

from ringlight.core.camera import Camera
from ringlight.core.gaussians import GEOMETRY, Gaussians
from ringlight.core.rendering import Emission, Footprint, Raster
from ringlight.core.want import Want
from ringlight.rasterize import convention
from ringlight.rasterize.by_torch import drawn_by_torch
from ringlight.rasterize.contract import RasterOptions
from ringlight.rasterize.finite import refuse_if_not_finite
from ringlight.rasterize.projection import Projection, project

BAND_PIXELS = 512
"""Pixels blended at a time. Memory is this times the Gaussians that touch the band: 8 MB per tensor for 2,000."""


class ReferenceRasterizer:
    """Blends every pixel over all Gaussians that reach it, nearest first."""

    name = "reference"
    device = torch.device("cpu")
    note: str | None = None

    def draw(
        self,
        gaussians: Gaussians,
        emission: Emission,
        camera: Camera,
        background: Float[Tensor, "C"],
        options: RasterOptions = RasterOptions(),
        want: Want = Want.EXACT,
        tiles: object = None,
    ) -> Raster:
        """See :class:`ringlight.rasterize.contract.Rasterizer`; ignores both hints."""

        def blend(columns: Mapping[str, Tensor | None]) -> tuple[Tensor, Tensor, Footprint]:
            return blended(columns, camera, background, options)

        return drawn_by_torch(blend, gaussians, emission, want)


def blended(
    columns: Mapping[str, Tensor | None], camera: Camera, background: Float[Tensor, "C"], options: RasterOptions
) -> tuple[Float[Tensor, "H W C"], Float[Tensor, "H W 1"], Footprint]:
    """Image, alpha and footprint of the geometry's columns, "channels" and "opacity_factor", by plain torch.

    Also differentiable in the camera's pose.
    """
    refuse_if_not_finite(columns, camera, background)
    channels, factor = columns["channels"], columns["opacity_factor"]
    assert channels is not None
    geometry = Gaussians.from_columns({name: columns[name] for name in GEOMETRY})  # type: ignore[misc]
    factor = torch.ones_like(geometry.opacity_logits) if factor is None else factor
    rows = _rows_to_draw(geometry, camera, options, factor)
    # Gathering the rows before any arithmetic gives all others a gradient of exactly zero, whatever overflowed.
    splats = project(geometry.rows(rows), camera, options, factor[rows])
    centers = _CenterGradients(splats, rows, len(geometry), options.absgrad)
    colors = channels[rows]

    def band(top: int, bottom: int) -> Float[Tensor, "h W D"]:
        touching = _touching(splats, top, bottom).nonzero()[:, 0]
        pixels = _pixel_centers(camera.width, top, bottom, like=colors)
        pair_centers = centers.copied_per_pixel(len(pixels), touching)
        alphas = pair_alphas(splats.rows(touching), pair_centers, pixels, options.max_alpha)
        return _blend(alphas, colors[touching], background).unflatten(0, (bottom - top, camera.width))

    height = max(1, BAND_PIXELS // camera.width)
    tops = range(0, camera.height, height)
    # checkpoint: the backward pass computes a band again instead of keeping all its pairs.
    bands = [checkpoint(band, y, min(y + height, camera.height), use_reentrant=False) for y in tops]
    image = torch.cat(bands)
    return image[..., :-1], image[..., -1:], centers.footprint


def pair_alphas(
    splats: Projection, centers: Float[Tensor, "P K 2"], pixels: Float[Tensor, "P 2"], max_alpha: float
) -> Float[Tensor, "P K"]:
    """Opacity of Gaussian k at pixel p, 0 where it is skipped. A clamped one passes no gradient to the geometry."""
    x, y = (pixels[:, None] - centers).unbind(-1)
    xx, xy, yy = splats.conics.unbind(-1)
    sigmas = 0.5 * (xx * x * x + yy * y * y) + xy * x * y
    alphas = (splats.opacities * (-sigmas).exp()).clamp_max(max_alpha)
    return torch.where((sigmas >= 0) & (alphas >= convention.MIN_ALPHA), alphas, 0)


def _blend(
    alphas: Float[Tensor, "P K"], colors: Float[Tensor, "K C"], background: Float[Tensor, "C"]
) -> Float[Tensor, "P D"]:
    """Front to back; D = C + 1, the last column is the accumulated alpha."""
    with torch.no_grad():
        # Stopping before the Gaussian that would go too far is the same as ignoring it and all behind it.
        alive = (1 - alphas).cumprod(1) > convention.MIN_TRANSMITTANCE
    alphas = torch.where(alive, alphas, 0)
    transmittances = torch.cat([alphas.new_ones(len(alphas), 1), (1 - alphas).cumprod(1)], 1)
    weights, remaining = alphas * transmittances[:, :-1], transmittances[:, -1:]
    return torch.cat([weights @ colors + remaining * background.to(colors), 1 - remaining], 1)


@torch.no_grad()
def _rows_to_draw(geometry: Gaussians, camera: Camera, options: RasterOptions, factor: Tensor) -> Int[Tensor, "K"]:
    """Rows that fall on the image, nearest first, equal depths in the order of the table."""
    projection = project(geometry, camera, options, factor)
    rows = projection.on_image(camera, options.near).nonzero()[:, 0]
    return rows[projection.depths[rows].argsort(stable=True)]


def _touching(splats: Projection, top: int, bottom: int) -> Bool[Tensor, "K"]:
    y, radius = splats.means2d[:, 1], splats.radii[:, 1]
    return (y + radius >= top) & (y - radius <= bottom)


def _pixel_centers(width: int, top: int, bottom: int, like: Tensor) -> Float[Tensor, "P 2"]:
    y, x = torch.meshgrid(torch.arange(top, bottom), torch.arange(width), indexing="ij")
    return torch.stack([x, y], -1).reshape(-1, 2).to(like) + 0.5


class _CenterGradients:
    """Fills in a footprint's gradients while ``backward`` runs, on the table's N rows."""

    def __init__(self, splats: Projection, rows: Int[Tensor, "K"], count: int, absolute: bool):
        self._centers, self._rows, self._count = splats.means2d, rows, count
        self._absolute = splats.means2d.new_zeros(len(rows), 2) if absolute else None
        self.footprint = Footprint(self._on_table_rows(splats.means2d.detach()), self._on_table_rows(splats.radii))
        if self._centers.requires_grad:
            self._centers.register_hook(self._finish)

    def copied_per_pixel(self, pixels: int, chosen: Int[Tensor, "k"]) -> Float[Tensor, "P k 2"]:
        """One copy of each chosen centre per pixel: the gradients of the copies are those of single pixels."""
        copies = self._centers[chosen].expand(pixels, -1, -1)
        absolute = self._absolute
        if absolute is not None and copies.requires_grad:

            def accumulate(gradient: Float[Tensor, "P k 2"]) -> None:
                absolute.index_add_(0, chosen, gradient.abs().sum(0))

            copies.register_hook(accumulate)
        return copies

    def _finish(self, gradient: Float[Tensor, "K 2"]) -> None:
        self.footprint.means2d_gradient = self._on_table_rows(gradient)
        if self._absolute is not None:
            self.footprint.absolute_gradient = self._on_table_rows(self._absolute)
            self._absolute.zero_()  # a graph may be gone back through again

    def _on_table_rows(self, values: Float[Tensor, "K 2"]) -> Float[Tensor, "N 2"]:
        return values.new_zeros(self._count, 2).index_copy_(0, self._rows, values)
