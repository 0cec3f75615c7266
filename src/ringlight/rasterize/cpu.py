"""The CPU back end: autograd around the compiled kernels.

The kernels take the table as stored and return gradients of the stored parameters, so one step costs two calls. What
a forward pass leaves for its backward pass lies in a workspace that is used again and again.
"""

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from ringlight.core.camera import Camera
from ringlight.core.gaussians import GEOMETRY, Gaussians
from ringlight.core.memory import machine_memory
from ringlight.core.rendering import Raster
from ringlight.errors import BackendError
from ringlight.rasterize.contract import RasterOptions
from ringlight.rasterize.cpu_job import Job, as_raster, check, refusals_named
from ringlight.rasterize.direct import DirectRaster

try:
    from ringlight import _kernels
except ImportError:  # the constructor says what to do about it
    _kernels = None  # type: ignore[assignment]


class CpuRasterizer:
    """Own SIMD kernels (AVX-512, AVX2 or generic, chosen at run time); any number of channels, float32.

    The image's memory is planar. Results do not depend on the number of threads, bit for bit.
    Raises BackendError where the compiled module is missing or the input is nothing that it can draw.
    """

    name = "cpu"
    device = torch.device("cpu")

    def __init__(self) -> None:
        if _kernels is None:
            raise BackendError(
                "the compiled module ringlight._kernels is missing; install the package with 'pip install .' "
                "or run 'make setup'"
            )
        _kernels.set_memory(machine_memory())
        self._spare: list[_kernels.Workspace] = []

    def __call__(
        self,
        gaussians: Gaussians,
        channels: Float[Tensor, "N C"],
        camera: Camera,
        background: Float[Tensor, "C"],
        options: RasterOptions = RasterOptions(),
        opacity_factor: Float[Tensor, "N"] | None = None,
    ) -> Raster:
        """Blend front to back by camera depth; see :class:`ringlight.rasterize.contract.Rasterizer`."""
        columns = _columns(gaussians, channels, camera, opacity_factor)
        with refusals_named(columns, camera, background):
            job = Job(camera, background, options, len(gaussians))
            if torch.is_grad_enabled() and any(column is not None and column.requires_grad for column in columns):
                image, alpha = _Rasterize.apply(job, self._spare, *columns)
            else:
                image, alpha = as_raster(*_Loan(self._spare).draw(job, job.table(columns)))
        return Raster(image, alpha, job.footprint)

    @torch.no_grad()
    def draw_late(
        self,
        gaussians: Gaussians,
        checked: Float[Tensor, "N 3"],
        late: "_kernels.LazyColors",
        camera: Camera,
        background: Float[Tensor, "3"],
        options: RasterOptions = RasterOptions(),
        opacity_factor: Float[Tensor, "N"] | None = None,
    ) -> Raster | None:
        """See :class:`ringlight.rasterize.contract.LateRasterizer`."""
        columns = _columns(gaussians, checked, camera, opacity_factor)
        loan = _Loan(self._spare)
        try:
            job = Job(camera, background, options, len(gaussians))
            image, alpha = as_raster(*job.draw(loan.workspace, job.table(columns), late, early_stop=True))
        except ValueError:  # something is not finite: who has all colours at hand can say what
            return None
        return Raster(image, alpha, job.footprint)

    @torch.no_grad()
    def shaded(
        self,
        gaussians: Gaussians,
        channels: Float[Tensor, "N C"],
        camera: Camera,
        background: Float[Tensor, "C"],
        shader: "_kernels.PictureShader",
        options: RasterOptions = RasterOptions(),
        opacity_factor: Float[Tensor, "N"] | None = None,
    ) -> Raster:
        """See :class:`ringlight.rasterize.contract.ShadingRasterizer`."""
        columns = _columns(gaussians, channels, camera, opacity_factor)
        with refusals_named(columns, camera, background):
            job, loan = Job(camera, background, options, len(gaussians)), _Loan(self._spare)
            image, alpha = as_raster(*job.draw(loan.workspace, job.table(columns), shader=shader, early_stop=True))
        return Raster(image, alpha, job.footprint)

    def direct(self) -> DirectRaster:
        """The same without autograd, for training loops."""
        return DirectRaster()


def _columns(
    gaussians: Gaussians, channels: Float[Tensor, "N C"], camera: Camera, opacity_factor: Float[Tensor, "N"] | None
) -> list[Tensor | None]:
    """The table as the kernels take it; refuses what they would refuse."""
    columns = [getattr(gaussians, name) for name in GEOMETRY] + [opacity_factor, channels]
    check(columns, camera)
    return [None if column is None else column.contiguous().resolve_neg() for column in columns]


class _Loan:
    """A workspace out of the pool: it goes back after backward, or with a graph that never ran one."""

    def __init__(self, spare: "list[_kernels.Workspace]") -> None:
        self._spare = spare
        self.workspace = spare.pop() if spare else _kernels.Workspace()
        self._returned = False
        self._passes = -1

    def draw(self, job: "Job", table: "_kernels.SplatTable") -> tuple[Tensor, Tensor]:
        """A forward pass that this loan stands for."""
        outputs = job.draw(self.workspace, table)
        self._passes = self.workspace.passes
        return outputs

    def reclaim(self, job: "Job", table: "_kernels.SplatTable") -> None:
        """Make the workspace hold the forward pass again, for a second backward through a retained graph."""
        if not self._returned:
            return
        if self.workspace in self._spare:
            self._spare.remove(self.workspace)
        else:
            self.workspace = _kernels.Workspace()
        self._returned = False
        if self.workspace.passes != self._passes:  # others have used it since: the same bits once more
            self.draw(job, table)

    def give_back(self) -> None:
        """Let the next forward pass have the workspace."""
        if not self._returned:
            self._returned = True
            self._spare.append(self.workspace)

    def __del__(self) -> None:
        self.give_back()


class _Rasterize(torch.autograd.Function):
    """Image [H W C] and alpha [H W 1], of planar memory, from the columns; ``job`` says the rest.

    Axes are turned in here, where autograd keeps no record of it: a step saves four nodes of its graph.
    """

    @staticmethod
    def forward(
        ctx: Any, job: Job, spare: "list[_kernels.Workspace]", *columns: Tensor | None
    ) -> tuple[Tensor, Tensor]:
        ctx.set_materialize_grads(False)
        ctx.job, ctx.loan = job, _Loan(spare)
        image, alpha = ctx.loan.draw(job, job.table(columns))
        ctx.save_for_backward(image, *columns)  # the columns, so that torch notices when one is changed in place
        return as_raster(image, alpha)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, by_image: Tensor | None, by_alpha: Tensor | None) -> tuple[Tensor | None, ...]:
        image, *columns = ctx.saved_tensors
        job, loan = ctx.job, ctx.loan
        by_columns: list[Any] = [None if column is None else torch.empty_like(column) for column in columns]
        means, log_scales, quats, opacity_logits, opacity_factor, channels = by_columns
        by_center = torch.empty_like(job.footprint.means2d)
        absolute = torch.empty_like(by_center) if job.absgrad else None
        by_image = torch.zeros_like(image) if by_image is None else by_image.permute(2, 0, 1).contiguous()
        by_alpha = None if by_alpha is None else by_alpha.squeeze(-1).contiguous()
        table = job.table(columns)  # anew: a column whose ``data`` was set since then has other memory
        loan.reclaim(job, table)
        gradients = _kernels.SplatGradients(
            means, log_scales, quats, opacity_logits, opacity_factor, channels, by_center, absolute
        )
        loan.workspace.backward(table, image, by_image, by_alpha, gradients)
        loan.give_back()
        job.note(by_center, absolute)
        return (None, None, *by_columns)
