"""gsplat's own pure-torch functions in the place of its CUDA kernels, for the back end's tests without a GPU.

Two things they lack are added here: the list of (Gaussian, pixel) pairs, which gsplat makes on the GPU only, and the
two functions of nerfacc by which it blends them.
"""

import inspect
import sys
from itertools import pairwise
from types import ModuleType
from typing import Any

import pytest
import torch
from torch import Tensor

from ringlight.rasterize import convention
from ringlight.rasterize.cuda import CudaRasterizer
from ringlight.rasterize.gsplat_seam import Gsplat

SIGMAS = 3.33


def torch_gsplat_rasterizer() -> CudaRasterizer:
    """The CUDA back end on the CPU. Skips the calling test where gsplat is missing."""
    return CudaRasterizer(Gsplat(TorchGsplat()), torch.device("cpu"))


class TorchGsplat:
    """gsplat's four functions for one packed image. Calls are held to the signatures of the installed gsplat."""

    def __init__(self) -> None:
        self._gsplat = pytest.importorskip("gsplat", reason="needs gsplat, which the dev extra installs on Linux")
        self._impl = __import__("gsplat.cuda._torch_impl", fromlist=["_torch_impl"])
        self._wrapper = __import__("gsplat.cuda._wrapper", fromlist=["_wrapper"])
        self.__version__ = self._gsplat.__version__

    def fully_fused_projection(self, *arguments, **named):
        """gsplat's torch function projects all rows; which of them are kept is decided here as its kernels do."""
        call = self._bound("fully_fused_projection", arguments, named)
        assert call["packed"]
        assert len(call["means"]), "gsplat's kernels divide by their number"
        assert call["covars"] is None
        columns, opacities = (call["means"], call["quats"], call["scales"]), call["opacities"]
        with torch.no_grad():
            radii, means2d, _, conics, compensations = self._projected(*columns, call)
            strength = opacities if compensations is None else opacities * compensations
            reach = (2 * (strength / convention.MIN_ALPHA).clamp_min(1).log()).sqrt().clamp_max(SIGMAS)
            determinants = conics[:, 0] * conics[:, 2] - conics[:, 1] ** 2
            variances = torch.stack([conics[:, 2], conics[:, 0]], 1) / determinants[:, None]
            tight = (reach[:, None] * variances.sqrt()).ceil()
            size = torch.tensor([call["width"], call["height"]])
            on_image = ((means2d + tight > 0) & (means2d - tight < size)).all(1)
            drawn = (radii > 0).all(1) & (strength >= convention.MIN_ALPHA) & (tight > 0).all(1) & on_image
            rows = drawn.nonzero()[:, 0]
        # Only these: in those that the kernels leave out torch would multiply zeros by infinities.
        _, means2d, depths, conics, compensations = self._projected(*(column[rows] for column in columns), call)
        zeros = torch.zeros_like(rows)
        return zeros, zeros, rows, tight[rows].int(), means2d, depths, conics, compensations

    def _projected(self, means, quats, scales, call: dict[str, Any]):
        covariances, _ = self._impl._quat_scale_to_covar_preci(quats, scales, compute_preci=False)
        same = ("viewmats", "Ks", "width", "height", "eps2d", "near_plane", "far_plane", "calc_compensations")
        found = self._impl._fully_fused_projection(means, covariances, *(call[name] for name in same))
        return (None if part is None else part[0] for part in found)

    def isect_tiles(self, *arguments, **named):
        call = self._bound("isect_tiles", arguments, named)
        assert call["packed"]
        assert call["n_images"] == 1
        assert len(call["image_ids"]) == len(call["gaussian_ids"]) == len(call["means2d"])
        return self._impl._isect_tiles(
            *(call[name][None] for name in ("means2d", "radii", "depths")),
            *(call[name] for name in ("tile_size", "tile_width", "tile_height")),
        )

    def isect_offset_encode(self, *arguments, **named):
        return self._impl._isect_offset_encode(*self._bound("isect_offset_encode", arguments, named).values())

    def rasterize_to_pixels(self, *arguments, **named):
        call = self._bound("rasterize_to_pixels", arguments, named)
        assert call["packed"]
        means2d, lists = call["means2d"], call["flatten_ids"]
        width, height = call["image_width"], call["image_height"]
        if not len(lists):
            blank = torch.zeros(1, height, width, call["colors"].shape[1])
            return blank, blank[..., :1]
        with pytest.MonkeyPatch.context() as patch:
            patch.setitem(sys.modules, "nerfacc", _nerfacc())
            patch.setattr(self._wrapper, "rasterize_to_indices_in_range", _pairs)
            counted = means2d if call["absgrad"] else None
            patch.setattr(self._impl, "accumulate", _Accumulate(self._impl.accumulate, counted))
            packed = (call[name][None] for name in ("means2d", "conics", "colors", "opacities"))
            return self._impl._rasterize_to_pixels(
                *packed, width, height, call["tile_size"], call["isect_offsets"], lists
            )

    def _bound(self, name: str, arguments: tuple[Any, ...], named: dict[str, Any]) -> dict[str, Any]:
        """The call as the installed gsplat would take it. Raises TypeError where it would not."""
        bound = inspect.signature(getattr(self._gsplat, name)).bind(*arguments, **named)
        bound.apply_defaults()
        return bound.arguments


class _Accumulate:
    """gsplat's blending of pairs, on a copy of each centre per pair: their gradients are those of single pixels."""

    def __init__(self, original: Any, centers: Tensor | None):
        self._original, self._centers = original, centers

    def __call__(self, means2d, conics, opacities, colors, gaussians, pixels, images, width, height):
        copies, centers = means2d[images, gaussians], self._centers
        if centers is not None and copies.requires_grad:

            def note(gradient: Tensor) -> None:
                centers.absgrad = torch.zeros_like(centers).index_add_(0, gaussians, gradient.abs())

            copies.register_hook(note)
        pairs = (conics[images, gaussians], opacities[images, gaussians], colors[images, gaussians])
        own = torch.arange(len(gaussians))
        packed = (values[None] for values in (copies, *pairs))
        return self._original(*packed, own, pixels, images, width, height)


@torch.no_grad()
def _pairs(begin, end, transmittances, means2d, conics, opacities, width, height, tile, offsets, order):
    """Gaussians of each pixel, nearest first, as gsplat's kernel lists them: see its rasterize_to_indices_in_range."""
    assert begin == 0, "one batch holds all"
    bounds = torch.cat([offsets.flatten(), torch.tensor([len(order)], dtype=offsets.dtype)]).tolist()
    across = offsets.shape[-1]
    gaussians, pixels = [], []
    for number, (first, last) in enumerate(pairwise(bounds)):
        top, left = number // across * tile, number % across * tile
        y, x = torch.meshgrid(
            torch.arange(top, min(top + tile, height)), torch.arange(left, min(left + tile, width)), indexing="ij"
        )
        x, y, near = x.flatten(), y.flatten(), order[first:last].long()
        dx = x[:, None] + 0.5 - means2d[0, near, 0]
        dy = y[:, None] + 0.5 - means2d[0, near, 1]
        xx, xy, yy = conics[0, near].unbind(-1)
        sigmas = 0.5 * (xx * dx * dx + yy * dy * dy) + xy * dx * dy
        alphas = (opacities[0, near] * (-sigmas).exp()).clamp_max(convention.MAX_ALPHA)
        used = (sigmas >= 0) & (alphas >= convention.MIN_ALPHA)
        used &= (1 - torch.where(used, alphas, 0)).cumprod(1) > convention.MIN_TRANSMITTANCE
        pixel, which = used.nonzero(as_tuple=True)
        gaussians.append(near[which])
        pixels.append((y * width + x)[pixel])
    found = torch.cat(gaussians)
    return found, torch.cat(pixels), torch.zeros_like(found)


def _nerfacc() -> ModuleType:
    """The two functions, by their documentation: pairs of one ray follow one another."""
    module = ModuleType("nerfacc")
    module.render_weight_from_alpha = _weights
    module.accumulate_along_rays = _sums
    return module


def _weights(alphas: Tensor, ray_indices: Tensor, n_rays: int) -> tuple[Tensor, Tensor]:
    order = ray_indices.argsort(stable=True)
    rays = ray_indices[order]
    counts = torch.bincount(rays, minlength=n_rays)
    places = torch.arange(len(rays)) - (counts.cumsum(0) - counts)[rays]
    table = alphas.new_zeros(n_rays, int(counts.max()) + 1).index_put((rays, places + 1), alphas[order])
    before = (1 - table).cumprod(1)[rays, places]
    back = torch.empty_like(order).index_copy_(0, order, torch.arange(len(order)))
    return alphas * before[back], before[back]


def _sums(weights: Tensor, values: Tensor | None, ray_indices: Tensor, n_rays: int) -> Tensor:
    each = weights[:, None] if values is None else weights[:, None] * values
    return each.new_zeros(n_rays, each.shape[1]).index_add(0, ray_indices, each)
