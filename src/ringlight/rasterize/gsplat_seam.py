"""The four functions of gsplat that the CUDA back end calls, and the numbers in which its versions differ.

Nothing else knows of gsplat, so that a test can put its own pure-torch functions in their place.
"""

from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from ringlight.rasterize import convention
from ringlight.rasterize.contract import RasterOptions

TILE = 16
"""Pixels on a side of gsplat's tiles: its own default, and its kernels' thread blocks."""

WIDTHS = (1, 2, 3, 4, 5, 8, 9, 16, 17, 32, 33, 64, 65, 128, 129, 256, 257, 512)
"""Numbers of channels that every version since 1.5.3 has compiled kernels for."""


@dataclass(frozen=True)
class GsplatNumbers:
    """What is compiled into gsplat's kernels, and not the same in all versions."""

    version: str
    max_alpha: float
    """Opacity of one Gaussian at one pixel is clamped to this."""
    least_compensation: float
    """Floor of the antialiasing factor."""


def numbers_of(version: str) -> GsplatNumbers:
    """Of gsplat 1.5.3 and of 1.6.0, by which later ones are judged too until they say otherwise."""
    major, minor = (int(part) for part in version.split(".")[:2])
    if (major, minor) < (1, 6):
        return GsplatNumbers(version, max_alpha=convention.MAX_ALPHA, least_compensation=0.0)
    return GsplatNumbers(version, max_alpha=0.99, least_compensation=0.005)


@dataclass(frozen=True)
class Ellipses:
    """The V Gaussians that fall on the image, in the order of the table; see ``Projection`` for the units."""

    rows: Int[Tensor, "V"]
    means2d: Float[Tensor, "V 2"]
    depths: Float[Tensor, "V"]
    conics: Float[Tensor, "V 3"]
    radii: Int[Tensor, "V 2"]
    compensations: Float[Tensor, "V"] | None


def tile_counts(size: tuple[int, int]) -> tuple[int, int]:
    """Tiles across and down that cover an image of this width and height."""
    width, height = size
    return -(-width // TILE), -(-height // TILE)


def _no_ellipses(means: Float[Tensor, "0 3"]) -> Ellipses:
    rows = torch.zeros(0, dtype=torch.int64, device=means.device)
    return Ellipses(rows, means.new_zeros(0, 2), means.new_zeros(0), means.new_zeros(0, 3), rows.new_zeros(0, 2), None)


class Gsplat:
    """gsplat's kernels for one image at a time, packed: rows that are not seen cost nothing after projection.

    ``package`` is gsplat, or what stands in for it: a ``__version__`` and the four functions.
    """

    def __init__(self, package: Any):
        self._gsplat = package
        self.numbers = numbers_of(package.__version__)

    def project(
        self,
        means: Float[Tensor, "N 3"],
        quats: Float[Tensor, "N 4"],
        scales: Float[Tensor, "N 3"],
        opacities: Float[Tensor, "N"],
        pose: Float[Tensor, "1 4 4"],
        lens: Float[Tensor, "1 3 3"],
        size: tuple[int, int],
        options: RasterOptions,
    ) -> Ellipses:
        """``size`` is width and height; ``opacities`` only bound the footprints, and get no gradient here."""
        if not len(means):  # gsplat divides by their number, which ends the process
            return _no_ellipses(means)
        found = self._gsplat.fully_fused_projection(
            means, None, quats, scales, pose, lens, *size,
            eps2d=options.eps2d, near_plane=options.near, far_plane=float("inf"),
            packed=True, calc_compensations=options.antialiased, opacities=opacities.detach(),
        )  # fmt: skip
        rows = found[2]
        radii, means2d, depths, conics, compensations = found[-5:]  # versions differ in what stands between
        return Ellipses(rows, means2d, depths, conics, radii, compensations if options.antialiased else None)

    def tiles(self, seen: Ellipses, size: tuple[int, int]) -> tuple[Int[Tensor, "1 tall wide"], Int[Tensor, "P"]]:
        """Where each tile's list begins, and the lists, nearest first: numbers of ellipses."""
        across, down = tile_counts(size)
        images = seen.rows.new_zeros(len(seen.rows))
        _, keys, lists = self._gsplat.isect_tiles(
            seen.means2d, seen.radii, seen.depths, TILE, across, down,
            packed=True, n_images=1, image_ids=images, gaussian_ids=seen.rows,
        )  # fmt: skip
        return self._gsplat.isect_offset_encode(keys, 1, across, down), lists

    def blend(
        self,
        seen: Ellipses,
        channels: Float[Tensor, "V C"],
        opacities: Float[Tensor, "V"],
        size: tuple[int, int],
        lists: tuple[Int[Tensor, "1 tall wide"], Int[Tensor, "P"]],
        absgrad: bool,
    ) -> tuple[Float[Tensor, "1 H W C"], Float[Tensor, "1 H W 1"]]:
        """Image over black, and alpha. With ``absgrad`` the backward pass sets ``seen.means2d.absgrad``."""
        image: Tensor
        alpha: Tensor
        image, alpha = self._gsplat.rasterize_to_pixels(
            seen.means2d, seen.conics, channels, opacities, *size, TILE, *lists, packed=True, absgrad=absgrad
        )
        return image, alpha
