"""The CPU back end: autograd around the compiled kernels.

The kernels take the table as stored and return gradients of the stored parameters, so one step costs two calls. What
a forward pass leaves for its backward pass lies in a workspace that is used again and again.
"""

from collections.abc import Sequence
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from ringlight.core.camera import Camera
from ringlight.core.gaussians import GEOMETRY, Gaussians
from ringlight.core.rendering import Footprint, Raster
from ringlight.errors import BackendError
from ringlight.rasterize.contract import RasterOptions
from ringlight.rasterize.finite import refuse_if_not_finite

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

    def __init__(self) -> None:
        if _kernels is None:
            raise BackendError(
                "the compiled module ringlight._kernels is missing; install the package with 'pip install .' "
                "or run 'make setup'"
            )
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
        columns = [getattr(gaussians, name) for name in GEOMETRY] + [opacity_factor, channels]
        _check(columns, camera)
        columns = [None if column is None else column.contiguous().resolve_neg() for column in columns]
        try:
            job = _Job(camera, background, options, len(gaussians))
            if torch.is_grad_enabled() and any(column is not None and column.requires_grad for column in columns):
                image, alpha = _Rasterize.apply(job, self._spare, *columns)
            else:
                image, alpha = _as_raster(*_Loan(self._spare).draw(job, job.table(columns)))
        except ValueError:  # the kernels only count what is not finite, in passing
            names = (*GEOMETRY, "opacity_factor", "channels")
            refuse_if_not_finite(dict(zip(names, columns, strict=True)), camera, background)
            raise
        return Raster(image, alpha, job.footprint)


def _check(columns: Sequence[Tensor | None], camera: Camera) -> None:
    """Refuse in a sentence what the kernels would refuse in a signature."""
    for column in columns:
        if column is not None and (column.dtype != torch.float32 or not column.is_cpu):
            raise BackendError(
                f"the cpu rasterizer draws float32 tensors on the CPU, not {column.dtype} on {column.device}; "
                "move the model there, or choose the rasterizer of its device"
            )
    if not (1 <= camera.width <= _kernels.MAX_IMAGE_SIDE and 1 <= camera.height <= _kernels.MAX_IMAGE_SIDE):
        raise BackendError(
            f"the cpu rasterizer draws images of 1 to {_kernels.MAX_IMAGE_SIDE} pixels a side, "
            f"not {camera.width} x {camera.height}; downscale the camera"
        )


class _Loan:
    """A workspace out of the pool: it goes back after backward, or with a graph that never ran one."""

    def __init__(self, spare: "list[_kernels.Workspace]") -> None:
        self._spare = spare
        self.workspace = spare.pop() if spare else _kernels.Workspace()
        self._returned = False
        self._passes = -1

    def draw(self, job: "_Job", table: "_kernels.SplatTable") -> tuple[Tensor, Tensor]:
        """A forward pass that this loan stands for."""
        outputs = job.draw(self.workspace, table)
        self._passes = self.workspace.passes
        return outputs

    def reclaim(self, job: "_Job", table: "_kernels.SplatTable") -> None:
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


class _Job:
    """One view to draw: everything about it that has no gradient."""

    def __init__(self, camera: Camera, background: Tensor, options: RasterOptions, count: int) -> None:
        pose = camera.world_to_camera.detach().float().contiguous()
        self.camera = _kernels.Pinhole(pose, camera.focal, camera.center, camera.width, camera.height)
        self.settings = _kernels.RasterSettings(
            options.eps2d, options.near, options.max_alpha, options.antialiased, options.absgrad
        )
        self.absgrad = options.absgrad
        self.size = (camera.height, camera.width)
        self.background = background.detach().float().contiguous()
        self.footprint = Footprint(self.background.new_empty(count, 2), self.background.new_empty(count, 2))

    def table(self, columns: Sequence[Any]) -> "_kernels.SplatTable":
        """The columns as the kernels take them: means, log_scales, quats, opacity_logits, opacity_factor, channels."""
        means, log_scales, quats, opacity_logits, opacity_factor, channels = columns
        return _kernels.SplatTable(means, log_scales, quats, opacity_logits, opacity_factor, channels, self.background)

    def draw(self, workspace: "_kernels.Workspace", table: "_kernels.SplatTable") -> tuple[Tensor, Tensor]:
        """The planar image [C H W] and alpha [H W]; fills in the footprint."""
        # Type and device are the background's: torch's defaults may be others.
        image, alpha = self.background.new_empty(len(self.background), *self.size), self.background.new_empty(self.size)
        footprint = self.footprint
        try:
            workspace.forward(table, self.camera, self.settings, image, alpha, footprint.means2d, footprint.radii)
        except MemoryError as error:
            size, count = f"{self.size[1]} x {self.size[0]}", len(footprint.radii)
            raise BackendError(
                f"{count} Gaussians on {size} pixels need more memory, or more time, than a view may take; "
                "they cover too much of the image: make the scales, the image or their number smaller"
            ) from error
        return image, alpha

    def note(self, gradient: Tensor, absolute: Tensor | None) -> None:
        """Add what one backward pass found to the footprint, as torch adds to ``grad``."""
        footprint = self.footprint
        known, known_absolute = footprint.means2d_gradient, footprint.absolute_gradient
        footprint.means2d_gradient = gradient if known is None else known + gradient
        if absolute is not None:
            footprint.absolute_gradient = absolute if known_absolute is None else known_absolute + absolute


def _as_raster(image: Float[Tensor, "C H W"], alpha: Float[Tensor, "H W"]) -> tuple[Tensor, Tensor]:
    """The same memory as the contract has it."""
    return image.permute(1, 2, 0), alpha.unsqueeze(-1)


class _Rasterize(torch.autograd.Function):
    """Image [H W C] and alpha [H W 1], of planar memory, from the columns; ``job`` says the rest.

    Axes are turned in here, where autograd keeps no record of it: a step saves four nodes of its graph.
    """

    @staticmethod
    def forward(
        ctx: Any, job: _Job, spare: "list[_kernels.Workspace]", *columns: Tensor | None
    ) -> tuple[Tensor, Tensor]:
        ctx.set_materialize_grads(False)
        ctx.job, ctx.loan = job, _Loan(spare)
        image, alpha = ctx.loan.draw(job, job.table(columns))
        ctx.save_for_backward(image, *columns)  # the columns, so that torch notices when one is changed in place
        return _as_raster(image, alpha)

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
