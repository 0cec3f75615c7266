"""The CPU back end: the compiled kernels, and what a forward pass leaves for its backward pass.

The kernels take the table as stored and return gradients of the stored parameters, so one step costs two calls.
"""

import contextlib
from collections.abc import Callable

import torch
from jaxtyping import Float, Int32
from torch import Tensor

from ringlight import _kernels
from ringlight.core.camera import Camera
from ringlight.core.gaussians import GEOMETRY, Gaussians
from ringlight.core.gradients import COLUMNS, Gradients
from ringlight.core.memory import machine_memory
from ringlight.core.rendering import Emission, EmissionGradients, KeptTiles, Raster, TileShading, no_way_back
from ringlight.core.want import Want
from ringlight.rasterize.contract import RasterOptions
from ringlight.rasterize.cpu_job import Job, Table, table_of
from ringlight.rasterize.finite import refuse_if_not_finite


class CpuRasterizer:
    """Own SIMD kernels (AVX-512, AVX2 or generic, chosen at run time); any number of channels, float32.

    The image's memory is planar. Results do not depend on the number of threads, bit for bit.
    """

    name = "cpu"
    device = torch.device("cpu")
    note: str | None = None

    def __init__(self) -> None:
        _kernels.set_memory(machine_memory())
        self.spare: list[Workplace] = []

    def draw(
        self,
        gaussians: Gaussians,
        emission: Emission,
        camera: Camera,
        background: Float[Tensor, "C"],
        options: RasterOptions = RasterOptions(),
        want: Want = Want.EXACT,
        tiles: TileShading | None = None,
    ) -> Raster:
        """See :class:`ringlight.rasterize.contract.Rasterizer`; takes both hints."""
        job, factor = Job(camera, background, options, len(gaussians)), emission.opacity_factor
        if emission.lazy is not None:
            checked = table_of(gaussians, emission.lazy.checked, factor)
            with contextlib.suppress(ValueError):  # not finite: with all colours at hand it can be said what
                return self._drawn(job, checked, want, lazy=emission.lazy.kernel)
        table = table_of(gaussians, emission.channels, factor)
        try:
            return self._drawn(job, table, want, tiles=tiles)
        except ValueError:  # the kernels only count what is not finite, in passing; this says where it is
            refuse_if_not_finite(table, camera, background)
            raise

    def _drawn(
        self,
        job: Job,
        table: Table,
        want: Want,
        lazy: "_kernels.LazyColors | None" = None,
        tiles: TileShading | None = None,
    ) -> Raster:
        loan, is_hinted = _Loan(self.spare), lazy is not None or tiles is not None
        keeps_tiles = tiles is not None and tiles.backward is not None and want is Want.GRADIENTS
        keeps_blended = tiles is not None and want is not Want.PICTURE and not keeps_tiles
        blended = job.background.new_empty(len(job.background), *job.size) if keeps_blended else None
        kept = loan.place.tiles(len(job.background) + 1, job.tile_pixels) if keeps_tiles else None
        early_stop = is_hinted and want is Want.PICTURE
        try:
            values = None if kept is None else kept.values
            shown, alpha = job.draw(loan.place.workspace, table, lazy, tiles, blended, values, early_stop)
        except BaseException:
            loan.give_back()  # who keeps the exception keeps this frame
            raise
        image, shaded = shown, None
        if tiles is not None:
            image, shaded = shown[:0] if blended is None else blended, shown.permute(1, 2, 0)
        backward: Callable[..., EmissionGradients] = no_way_back
        if want is Want.GRADIENTS:
            backward = _FromImage(job, table, image, loan)
            if kept is not None:
                backward = _FromTiles(job, table, kept.values, loan)
        return Raster(image.permute(1, 2, 0), alpha.unsqueeze(-1), job.footprint, backward, shaded, kept)


class Workplace:
    """What a view has to itself: the kernels' workspace, and memory for kept tiles.

    Memory that is asked for anew each step comes from the system page by page: 15 MB of a picture of 400 x 400 pixels
    would cost a fourth of a step of ``ringlight-mirror``.
    """

    def __init__(self) -> None:
        self.workspace = _kernels.Workspace()
        self._floats = torch.empty(0, dtype=torch.float32, device="cpu")

    def tiles(self, depth: int, pixels: int) -> KeptTiles:
        """For D numbers of so many pixels, and as much room."""
        wanted = depth * pixels
        if len(self._floats) < 2 * wanted:
            self._floats = self._floats.new_empty(0)  # the old ones go first
            self._floats = self._floats.new_empty(2 * wanted)
        values = self._floats[:wanted].view(pixels // _kernels.BLOCK_PIXELS, depth, _kernels.BLOCK_PIXELS)
        return KeptTiles(values, self._floats[wanted : 2 * wanted])


class _Loan:
    """A workplace out of the pool, to which it goes back once nobody holds the loan any more."""

    def __init__(self, spare: list[Workplace]) -> None:
        self._spare, self._is_back = spare, True  # nothing to give back if there is no memory for a workspace
        self.place = spare.pop() if spare else Workplace()
        self._is_back = False

    def give_back(self) -> None:
        """Let the next view have the workplace; once."""
        if not self._is_back:
            self._is_back = True
            self._spare.append(self.place)

    def __del__(self) -> None:
        self.give_back()


class _WayBack:
    """Gradients of one view: see :class:`ringlight.core.rendering.Raster`. May be called once."""

    def __init__(self, job: Job, table: Table, blended: Tensor, loan: _Loan) -> None:
        self._job, self._table, self._blended = job, table, blended
        self._loan: _Loan | None = loan

    def _go(self, into: Gradients, kernel: Callable[..., None]) -> EmissionGradients:
        if self._loan is None:
            raise RuntimeError("the way back of this view has been gone already; draw it again")
        job, found = self._job, {name: None if c is None else torch.empty_like(c) for name, c in self._table.items()}
        footprint = job.footprint
        footprint.means2d_gradient = torch.empty_like(footprint.means2d)
        footprint.absolute_gradient = torch.empty_like(footprint.means2d) if job.absgrad else None
        gradients = _kernels.SplatGradients(
            **found,  # type: ignore[arg-type]
            means2d=footprint.means2d_gradient,
            absolute=footprint.absolute_gradient,
        )
        kernel(self._loan.place.workspace, job.native(self._table), gradients)
        self._loan = None
        for name in GEOMETRY:
            into.add(COLUMNS + name, found[name])  # type: ignore[arg-type]
        grad_channels = found["channels"]
        assert grad_channels is not None
        return grad_channels, found["opacity_factor"]


class _FromImage(_WayBack):
    """Where planes of the whole image were blended, [C H W]."""

    def __call__(
        self, grad_image: Float[Tensor, "H W C"], grad_alpha: Float[Tensor, "H W 1"] | None, into: Gradients
    ) -> EmissionGradients:
        planes = grad_image.permute(2, 0, 1).contiguous()
        plane = None if grad_alpha is None else grad_alpha[..., 0].contiguous()

        def kernel(workspace: _kernels.Workspace, table: _kernels.SplatTable, to: _kernels.SplatGradients) -> None:
            workspace.backward(table, self._blended, planes, plane, to)

        return self._go(into, kernel)


class _FromTiles(_WayBack):
    """Where tiles were kept, [B C + 1 16]."""

    def __call__(
        self, grad_tiles: Float[Tensor, "B G 16"], drawn: Int32[Tensor, "B"], into: Gradients
    ) -> EmissionGradients:
        def kernel(workspace: _kernels.Workspace, table: _kernels.SplatTable, to: _kernels.SplatGradients) -> None:
            workspace.backward_of_tiles(table, self._blended, grad_tiles, drawn, to)

        return self._go(into, kernel)
