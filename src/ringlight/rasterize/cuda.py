"""The CUDA back end: gsplat (Ye et al. 2025), adapted to the contract.

One image at a time and packed: gsplat culls first, and everything after that sees the V rows on the image only.
gsplat adds gradients up in whatever order its threads come, so that two runs on a GPU do not give the same bits.
"""

from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.autograd.function import once_differentiable

from ringlight.core.camera import Camera
from ringlight.core.gaussians import GEOMETRY, Gaussians
from ringlight.core.rendering import Emission, Footprint, Raster
from ringlight.core.want import Want
from ringlight.errors import BackendError
from ringlight.rasterize import convention
from ringlight.rasterize.by_torch import drawn_by_torch
from ringlight.rasterize.contract import RasterOptions
from ringlight.rasterize.finite import refuse_if_not_finite
from ringlight.rasterize.gsplat_seam import WIDTHS, Ellipses, Gsplat
from ringlight.rasterize.stored_form import active_form


class CudaRasterizer:
    """gsplat's kernels; any number of channels up to 512, float32, memory [H W C].

    ``device`` is where models must lie. Raises BackendError for an input that cannot be drawn.
    """

    name = "cuda"

    def __init__(self, gsplat: Gsplat, device: torch.device | None = None):
        self.gsplat, self.device = gsplat, device or torch.device("cuda")

    @property
    def note(self) -> str | None:
        """A sentence on what this version of gsplat does otherwise than the other back ends, if anything."""
        numbers = self.gsplat.numbers
        if numbers.max_alpha == convention.MAX_ALPHA:
            return None
        return (
            f"gsplat {numbers.version} ends a Gaussian's opacity at {numbers.max_alpha}, not {convention.MAX_ALPHA}: "
            "dense surfaces look a little otherwise on the CPU; gsplat 1.5.3 draws alike"
        )

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

        def blend(columns: dict[str, Tensor | None]) -> tuple[Tensor, Tensor, Footprint]:
            return self._blended(columns, camera, background, options)

        return drawn_by_torch(blend, gaussians, emission, want)

    def _blended(
        self, columns: dict[str, Tensor | None], camera: Camera, background: Float[Tensor, "C"], options: RasterOptions
    ) -> tuple[Tensor, Tensor, Footprint]:
        given = {name: column for name, column in columns.items() if column is not None}
        self._check(given, options)
        _refuse_if_not_finite(given, camera, background)
        gaussians, channels = Gaussians.from_columns({name: given[name] for name in GEOMETRY}), given["channels"]
        factor = given.get("opacity_factor")
        quats, scales, opacities = active_form(gaussians, camera, options.near, factor)
        size = (camera.width, camera.height)
        seen = self.gsplat.project(gaussians.means, quats, scales, opacities, *self._pinhole(camera), size, options)
        footprint = _footprint(seen, len(gaussians))
        if not len(seen.rows):
            image, alpha = _nothing(given, camera, background.to(self.device), seen, footprint, options.absgrad)
            return image, alpha, footprint
        opacities, values = _Gathered.apply(seen.rows, opacities, channels)
        opacities = _compensated(opacities, seen.compensations, self.gsplat.numbers.least_compensation)
        lists = self.gsplat.tiles(seen, size)
        image, alpha = self.gsplat.blend(seen, _padded(values), opacities, size, lists, options.absgrad)
        if seen.means2d.requires_grad:
            seen.means2d.register_hook(_Notes(seen, footprint, options.absgrad))
        return _over(image[0, ..., : channels.shape[1]], alpha[0], background), alpha[0], footprint

    def _check(self, columns: dict[str, Tensor], options: RasterOptions) -> None:
        for name, column in columns.items():
            if column.dtype != torch.float32 or column.device.type != self.device.type:
                raise BackendError(
                    f"the cuda rasterizer draws float32 tensors on {self.device}, not {column.dtype} on "
                    f"{column.device} ({name}); move the model there, or choose the rasterizer of its device"
                )
        if columns["channels"].shape[1] > WIDTHS[-1]:
            raise BackendError(f"gsplat blends up to {WIDTHS[-1]} channels, not {columns['channels'].shape[1]}")
        if options.max_alpha not in (convention.MAX_ALPHA, self.gsplat.numbers.max_alpha):
            numbers = self.gsplat.numbers
            raise BackendError(
                f"gsplat {numbers.version} ends opacities at {numbers.max_alpha}, which is compiled into it, not at "
                f"{options.max_alpha}; use --device cpu for other values"
            )

    def _pinhole(self, camera: Camera) -> tuple[Float[Tensor, "1 4 4"], Float[Tensor, "1 3 3"]]:
        """Pose and lens on the device, by one copy."""
        (fx, fy), (cx, cy) = camera.focal, camera.center
        lens = torch.tensor([fx, 0, cx, 0, fy, cy, 0, 0, 1], dtype=torch.float32)
        numbers = torch.cat([camera.world_to_camera.detach().float().flatten(), lens]).to(self.device)
        return numbers[:16].view(1, 4, 4), numbers[16:].view(1, 3, 3)


def _refuse_if_not_finite(columns: dict[str, Tensor], camera: Camera, background: Tensor) -> None:
    """One number for all columns, read once: a sum of squares is not finite where any value is not."""
    norms = torch._foreach_norm([column.detach() for column in columns.values()])
    if not torch.stack(norms).sum().isfinite():  # or because squares overflow: then nothing is found
        refuse_if_not_finite(columns, camera, background)
    refuse_if_not_finite({}, camera, background)


def _compensated(opacities: Tensor, compensations: Tensor | None, least: float) -> Tensor:
    """Below its floor the factor is not known, and so small that the Gaussian is not drawn without the floor either."""
    if compensations is None:
        return opacities
    return opacities * torch.where(compensations > least, compensations, 0)


def _padded(values: Float[Tensor, "V C"]) -> Float[Tensor, "V W"]:
    """Zeros up to the next number of channels for which there are kernels."""
    channels = values.shape[1]
    width = next(width for width in WIDTHS if width >= max(channels, 1))
    return values if width == channels else torch.nn.functional.pad(values, (0, width - channels))


def _over(image: Float[Tensor, "H W C"], alpha: Float[Tensor, "H W 1"], background: Tensor) -> Float[Tensor, "H W C"]:
    """The image over the background. Not by gsplat, whose versions want a packed image's in different shapes."""
    if not background.is_cuda and not background.any():
        return image
    return torch.addcmul(image, 1 - alpha, background.detach().to(image))


def _footprint(seen: Ellipses, count: int) -> Footprint:
    means2d, radii = seen.means2d.detach(), seen.radii.to(seen.means2d.dtype)
    return Footprint(_on_table_rows(seen.rows, means2d, count), _on_table_rows(seen.rows, radii, count))


def _on_table_rows(rows: Int[Tensor, "V"], values: Float[Tensor, "V 2"], count: int) -> Float[Tensor, "N 2"]:
    return values.new_zeros(count, 2).index_copy_(0, rows, values)


def _nothing(
    columns: dict[str, Tensor],
    camera: Camera,
    background: Tensor,
    seen: Ellipses,
    footprint: Footprint,
    absolute: bool,
) -> tuple[Float[Tensor, "H W C"], Float[Tensor, "H W 1"]]:
    """The background and alpha, with a gradient of zero to every column and centre."""
    zero = sum((column[:0].sum() for column in columns.values()), background.new_zeros(()))
    if zero.requires_grad:
        note = _Notes(seen, footprint, absolute)
        seen.means2d.absgrad = seen.means2d  # type: ignore[attr-defined]
        zero.register_hook(lambda _: note(seen.means2d.detach()))
    shape = (camera.height, camera.width)
    return background.expand(*shape, -1) + zero, zero.expand(*shape, 1)


class _Notes:
    """Writes the gradients of the centres into the footprint, on the table's N rows, while ``backward`` runs."""

    def __init__(self, seen: Ellipses, footprint: Footprint, absolute: bool):
        self._rows, self._footprint = seen.rows, footprint
        # gsplat hangs the absolute gradient on the tensor of centres; a reference to it from its own hook is a cycle,
        # which the garbage collector finds.
        self._centers = seen.means2d if absolute else None

    def __call__(self, gradient: Float[Tensor, "V 2"]) -> None:
        footprint, count = self._footprint, len(self._footprint.radii)
        footprint.means2d_gradient = _on_table_rows(self._rows, gradient, count)
        if self._centers is not None:
            absolute = self._centers.absgrad.detach()  # type: ignore[attr-defined]
            footprint.absolute_gradient = _on_table_rows(self._rows, absolute, count)


class _Gathered(torch.autograd.Function):
    """Rows of two columns. Each is taken once, so that the way back is a copy and needs no sums, as indexing would."""

    @staticmethod
    def forward(ctx: Any, rows: Tensor, opacities: Tensor, channels: Tensor) -> tuple[Tensor, Tensor]:
        ctx.save_for_backward(rows)
        ctx.shapes = opacities.shape, channels.shape
        return opacities.index_select(0, rows), channels.index_select(0, rows)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        (rows,) = ctx.saved_tensors
        gradients_of_all = (
            gradient.new_zeros(shape).index_copy_(0, rows, gradient)
            for gradient, shape in zip(gradients, ctx.shapes, strict=True)
        )
        return None, *gradients_of_all
