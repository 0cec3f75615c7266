"""The socket: Gaussians and what they emit in, a blended image out."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.rendering import Emission, Raster, TileShading
from ringlight.core.want import Want
from ringlight.rasterize import convention


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

    @property
    def note(self) -> str | None:
        """A sentence on what this back end draws otherwise than the others, if anything."""
        ...

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
        """Blend front to back by camera depth. Finite input gives a finite image and finite gradients.

        The way back adds the gradients of the geometry, by column, and fills in the footprint. Hints that a back end
        may ignore: ``emission.lazy``, and ``tiles``, which shades while it is blended. A footprint ends where an
        opacity of 1 falls below 1/255; one that its factor makes greater, by dropout, is cut there as well.
        Raises BackendError naming column and rows where a value is not finite, whether or not the row can be seen.
        """
        ...
