"""The socket: Gaussians and channels in, a blended image out."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.rendering import Raster
from ringlight.rasterize import convention

if TYPE_CHECKING:
    from ringlight import _kernels


@dataclass(frozen=True)
class RasterOptions:
    """What back ends must agree on and a caller may change; the defaults are gsplat 1.5's."""

    eps2d: float = convention.EPS2D
    """Added to the diagonal of the 2-D covariance, square pixels."""
    near: float = convention.NEAR
    """Gaussians whose centre has a smaller camera z are culled, world units."""
    max_alpha: float = convention.MAX_ALPHA
    """Opacity of one Gaussian at one pixel is clamped to this."""
    antialiased: bool = False
    """Scale the opacity by sqrt(det / det_blurred), so that the low-pass filter keeps the energy (Mip-Splatting)."""
    absgrad: bool = False
    """Also accumulate the absolute screen-space gradients (AbsGS)."""


@runtime_checkable
class Rasterizer(Protocol):
    """A back end. Differentiable in the table's geometry, the channels, the opacity factor and nothing else."""

    name: str
    device: torch.device
    """Where a model must lie to be drawn; a model moves there when it is built."""

    def __call__(
        self,
        gaussians: Gaussians,
        channels: Float[Tensor, "N C"],
        camera: Camera,
        background: Float[Tensor, "C"],
        options: RasterOptions = RasterOptions(),
        opacity_factor: Float[Tensor, "N"] | None = None,
    ) -> Raster:
        """Blend front to back by camera depth. Finite input gives a finite image and finite gradients.

        Raises BackendError naming column and rows where a value is not finite, whether or not the row can be seen.
        ``opacity_factor`` is in [0, 1]: a footprint ends where an opacity of at most 1 falls below 1/255.
        """
        ...


@runtime_checkable
class LateRasterizer(Protocol):
    """A back end that asks for better colours where the picture shows a row, and for no others."""

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
        """The picture of :class:`Rasterizer` with ``late`` colours, without gradients; None where that would refuse.

        The last 1/64 of a pixel's light may be what lies in front of it, with alpha 1. ``checked`` is what colours are
        made of: it is not shown, but refused where it is not finite, like all else whether it is seen or not.
        """
        ...


@runtime_checkable
class ShadingRasterizer(Protocol):
    """A back end that hands tiles to a shader as soon as they are blended, for pictures without gradients."""

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
        """As :class:`Rasterizer`, but ``image`` [H W 3] holds the colours that ``shader`` makes; it is what a shader's
        ``tiles`` gave. The last 1/64 of a pixel's light may be taken for what lies in front of it, with alpha 1."""
        ...


@runtime_checkable
class DirectRasterizer(Protocol):
    """A picture and its gradient without autograd; a back end that can has a method ``direct()`` that makes one."""

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
        """As :class:`Rasterizer`. ``late`` colours, which are kept, go before the channels; one that is asked for
        and is not finite is a ValueError."""
        ...

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
        """As :meth:`draw`, and the colours that ``shader`` makes of the image while it is blended. The gradients asked
        for later are still those by the image."""
        ...

    def differentiate(
        self, by_image: Float[Tensor, "H W C"], by_alpha: Float[Tensor, "H W 1"] | None = None
    ) -> tuple[dict[str, Tensor], Float[Tensor, "N C"]]:
        """Gradients of the geometry's columns, and of "opacity_factor" if there was one, by name, and of the channels;
        fills in the footprint."""
        ...
