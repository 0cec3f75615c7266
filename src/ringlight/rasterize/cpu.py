"""The CPU back end: the compiled kernels, and what a forward pass leaves for its backward pass.

The kernels take the table as stored and return gradients of the stored parameters, so one step costs two calls.
"""

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight import _kernels
from ringlight.core.camera import Camera
from ringlight.core.gaussians import GEOMETRY, Gaussians
from ringlight.core.gradients import COLUMNS, Gradients
from ringlight.core.memory import machine_memory
from ringlight.core.rendering import Emission, EmissionGradients, LazyColors, Raster, no_way_back
from ringlight.core.want import Want
from ringlight.rasterize.contract import RasterOptions
from ringlight.rasterize.cpu_job import Job, Table, refusals_named, table_of


class CpuRasterizer:
    """Own SIMD kernels (AVX-512, AVX2 or generic, chosen at run time); any number of channels, float32.

    The image's memory is planar. Results do not depend on the number of threads, bit for bit.
    """

    name = "cpu"
    device = torch.device("cpu")
    note: str | None = None

    def __init__(self) -> None:
        _kernels.set_memory(machine_memory())
        self.spare: list[_kernels.Workspace] = []

    def draw(
        self,
        gaussians: Gaussians,
        emission: Emission,
        camera: Camera,
        background: Float[Tensor, "C"],
        options: RasterOptions = RasterOptions(),
        want: Want = Want.EXACT,
        tiles: "_kernels.PictureShader | None" = None,
    ) -> Raster:
        """See :class:`ringlight.rasterize.contract.Rasterizer`; takes both hints."""
        job = Job(camera, background, options, len(gaussians))
        if emission.lazy is not None:
            raster = self._drawn_lazily(job, emission.lazy, gaussians, emission.opacity_factor, want)
            if raster is not None:
                return raster
        table = table_of(gaussians, emission.channels, emission.opacity_factor)
        with _Loan(self.spare, want) as loan, refusals_named(table, camera, background):
            if tiles is None:
                image, alpha = job.draw(loan.workspace, table)
                return _raster(job, image, alpha, loan.way_back(job, table, image))
            channels, size = len(job.background), job.size
            blended = None if want is Want.PICTURE else job.background.new_empty(channels, *size)
            color, alpha = job.draw(
                loan.workspace, table, shader=tiles, blended=blended, early_stop=want is Want.PICTURE
            )
            image = color[:0] if blended is None else blended
            return _raster(job, image, alpha, loan.way_back(job, table, image), color.permute(1, 2, 0))

    def _drawn_lazily(
        self,
        job: Job,
        lazy: LazyColors,
        gaussians: Gaussians,
        opacity_factor: Tensor | None,
        want: Want,
    ) -> Raster | None:
        """None where something is not finite: with all colours at hand it can be said what."""
        table = table_of(gaussians, lazy.checked, opacity_factor)
        with _Loan(self.spare, want) as loan:
            try:
                image, alpha = job.draw(loan.workspace, table, lazy.kernel, early_stop=want is Want.PICTURE)
            except ValueError:
                return None
            return _raster(job, image, alpha, loan.way_back(job, table, image))


def _raster(
    job: Job,
    image: Float[Tensor, "C H W"],
    alpha: Float[Tensor, "H W"],
    back: "_WayBack | None",
    shaded: Tensor | None = None,
) -> Raster:
    """The same memory as the contract has it."""
    backward = no_way_back if back is None else back
    return Raster(image.permute(1, 2, 0), alpha.unsqueeze(-1), job.footprint, backward, shaded)


class _Loan:
    """A workspace out of the pool: it goes back at once, or where gradients are wanted with the way back."""

    def __init__(self, spare: "list[_kernels.Workspace]", want: Want) -> None:
        self._spare, self._want = spare, want
        self.workspace = spare.pop() if spare else _kernels.Workspace()
        self._is_kept = False

    def way_back(self, job: Job, table: Table, image: Float[Tensor, "C H W"]) -> "_WayBack | None":
        """The way back of what was drawn, if it is wanted, which then holds the workspace."""
        if self._want is not Want.GRADIENTS:
            return None
        self._is_kept = True
        return _WayBack(job, table, image, self)

    def give_back(self) -> None:
        """Let the next view have the workspace."""
        self._spare.append(self.workspace)

    def __enter__(self) -> "_Loan":
        return self

    def __exit__(self, *_: object) -> None:
        if not self._is_kept:
            self.give_back()


class _WayBack:
    """Gradients of one view: see :class:`ringlight.core.rendering.Raster`. May be called once."""

    def __init__(self, job: Job, table: Table, image: Float[Tensor, "C H W"], loan: _Loan) -> None:
        self._job, self._table, self._image = job, table, image
        self._loan: _Loan | None = loan

    def __call__(
        self, grad_image: Float[Tensor, "H W C"], grad_alpha: Float[Tensor, "H W 1"] | None, into: Gradients
    ) -> EmissionGradients:
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
        planes = grad_image.permute(2, 0, 1).contiguous()
        plane = None if grad_alpha is None else grad_alpha[..., 0].contiguous()
        self._loan.workspace.backward(job.native(self._table), self._image, planes, plane, gradients)
        self._return_loan()
        for name in GEOMETRY:
            into.add(COLUMNS + name, found[name])  # type: ignore[arg-type]
        grad_channels = found["channels"]
        assert grad_channels is not None
        return grad_channels, found["opacity_factor"]

    def _return_loan(self) -> None:
        if self._loan is not None:
            self._loan.give_back()
            self._loan = None

    def __del__(self) -> None:
        self._return_loan()
