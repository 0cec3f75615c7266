"""What rasterizers and models return: records, so that nothing crosses a border as a bare dictionary."""

from dataclasses import dataclass, field

from jaxtyping import Bool, Float
from torch import Tensor

Channels = dict[str, Float[Tensor, "... c"]]
"""Named values that get blended: "rgb" 3, "normal" 3, "depth" 1, ...

A colour model may also return the reserved name "opacity_factor" [N 1]: it multiplies the opacity and is not blended.
"""

OPACITY_FACTOR = "opacity_factor"


@dataclass
class Footprint:
    """Where the Gaussians fell on the image; the backward pass fills in the gradients.

    ``radii`` are half-extents in pixels (x, y), 0 for Gaussians that were not drawn. ``means2d_gradient`` is
    dL/d(projected centre) in 1/pixels, ``absolute_gradient`` the per-axis sum over pixels of its absolute value
    (AbsGS; only when ``RasterOptions.absgrad``). Both are None until ``backward`` has run.
    """

    means2d: Float[Tensor, "N 2"]
    radii: Float[Tensor, "N 2"]
    means2d_gradient: Float[Tensor, "N 2"] | None = None
    absolute_gradient: Float[Tensor, "N 2"] | None = None

    @property
    def visible(self) -> Bool[Tensor, "N"]:
        """Rows that were drawn into at least one tile."""
        return self.radii[:, 0] > 0


@dataclass(frozen=True)
class Raster:
    """One rasterization. ``image`` is blended over the background; memory may be planar, [C H W] permuted."""

    image: Float[Tensor, "H W C"]
    alpha: Float[Tensor, "H W 1"]
    footprint: Footprint


@dataclass(frozen=True)
class Rendering:
    """What a model shows from one camera: display-referred sRGB, nominally in [0, 1] (not clamped)."""

    color: Float[Tensor, "H W 3"]
    alpha: Float[Tensor, "H W 1"]
    buffers: Channels = field(default_factory=dict)
    raster: Raster | None = None
