"""The CPU back end without autograd, for training loops: the same kernels, at a fraction of what surrounds them."""

from collections.abc import Iterator
from contextlib import contextmanager

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.gaussians import GEOMETRY, Gaussians
from ringlight.core.rendering import OPACITY_FACTOR, Raster
from ringlight.rasterize.contract import RasterOptions
from ringlight.rasterize.cpu_job import Job, as_raster, check, refusals_named

try:
    from ringlight import _kernels
except ImportError:  # the rasterizer's constructor says what to do about it
    _kernels = None  # type: ignore[assignment]


class DirectRaster:
    """One view at a time: :meth:`draw`, then :meth:`differentiate`, which fills in that view's footprint.

    The gradients' arrays are used again by the next view; picture and footprint are new ones each time.
    """

    def __init__(self) -> None:
        self._workspace = _kernels.Workspace()
        self._gradients: list[Tensor] = []

    def draw(
        self,
        gaussians: Gaussians,
        channels: Float[Tensor, "N C"],
        camera: Camera,
        background: Float[Tensor, "C"],
        options: RasterOptions,
        opacity_factor: Float[Tensor, "N"] | None = None,
        late: "_kernels.LazyColors | None" = None,
    ) -> Raster:
        """See :class:`ringlight.rasterize.contract.DirectRasterizer`; every column is contiguous."""
        with self._begun(gaussians, channels, camera, background, options, opacity_factor):
            self._image, alpha = self._job.draw(self._workspace, self._table, late)
        return Raster(*as_raster(self._image, alpha), self._job.footprint)

    def draw_shaded(
        self,
        gaussians: Gaussians,
        channels: Float[Tensor, "N C"],
        camera: Camera,
        background: Float[Tensor, "C"],
        shader: "_kernels.PictureShader",
        options: RasterOptions,
        opacity_factor: Float[Tensor, "N"] | None = None,
    ) -> tuple[Raster, Float[Tensor, "H W 3"]]:
        """See :class:`ringlight.rasterize.contract.DirectRasterizer`."""
        with self._begun(gaussians, channels, camera, background, options, opacity_factor):
            self._image = channels.new_empty(channels.shape[1], camera.height, camera.width)
            color, alpha = self._job.draw(self._workspace, self._table, shader=shader, blended=self._image)
        return Raster(*as_raster(self._image, alpha), self._job.footprint), color.permute(1, 2, 0)

    @contextmanager
    def _begun(
        self,
        gaussians: Gaussians,
        channels: Float[Tensor, "N C"],
        camera: Camera,
        background: Float[Tensor, "C"],
        options: RasterOptions,
        opacity_factor: Float[Tensor, "N"] | None,
    ) -> Iterator[None]:
        self._columns = [gaussians.means, gaussians.log_scales, gaussians.quats, gaussians.opacity_logits]
        self._columns += [channels]
        self._factor = opacity_factor
        table = [*self._columns[:-1], opacity_factor, channels]
        check(table, camera)
        with refusals_named(table, camera, background):
            self._job = Job(camera, background, options, len(gaussians))
            self._table = self._job.table(table)
            yield

    def differentiate(
        self, by_image: Float[Tensor, "H W C"], by_alpha: Float[Tensor, "H W 1"] | None = None
    ) -> tuple[dict[str, Tensor], Float[Tensor, "N C"]]:
        """Gradients of the geometry's columns by name, and of the channels; fills in the footprint."""
        job = self._job
        gradients = self._arrays()
        by_center = torch.empty_like(job.footprint.means2d)
        absolute = torch.empty_like(by_center) if job.absgrad else None
        means, log_scales, quats, opacity_logits, channels = gradients
        factor = None if self._factor is None else torch.empty_like(self._factor)
        into = _kernels.SplatGradients(means, log_scales, quats, opacity_logits, factor, channels, by_center, absolute)
        by_planes = by_image.permute(2, 0, 1).contiguous()
        by_plane = None if by_alpha is None else by_alpha[..., 0].contiguous()
        self._workspace.backward(self._table, self._image, by_planes, by_plane, into)
        job.note(by_center, absolute)
        found = dict(zip(GEOMETRY, gradients, strict=False))
        return found if factor is None else found | {OPACITY_FACTOR: factor}, channels

    def _arrays(self) -> list[Tensor]:
        """One for each column, made anew when the table has another size."""
        shapes = [column.shape for column in self._columns]
        if [array.shape for array in self._gradients] != shapes:
            self._gradients = [torch.empty_like(column) for column in self._columns]
        return self._gradients
