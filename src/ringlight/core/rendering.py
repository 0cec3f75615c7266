"""What one view leaves at each seam: records that know their own way back.

Each way back may be gone once, and only where ``Want.GRADIENTS`` was said. It returns the gradient of what the part was
given, and adds those of the part's parameters to the :class:`~ringlight.core.gradients.Gradients` that it gets.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NoReturn

from jaxtyping import Bool, Float, Int32
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.computed_once import computed_once
from ringlight.core.gradients import Gradients

if TYPE_CHECKING:
    from ringlight import _kernels

Channels = dict[str, Float[Tensor, "..."]]
"""Named values that get blended, the last axis theirs: "rgb" 3, "normal" 3, "depth" 1, ..."""

EmissionGradients = tuple[Float[Tensor, "N C"], Float[Tensor, "N"] | None]
"""By the channels side by side, and by the opacity factor, if there was one."""

TileGradients = tuple[Float[Tensor, "B G 16"], Int32[Tensor, "B"]]
"""Of the first channels of kept tiles and, last, of alpha; and of each block which pixels have gradients beyond those
of the first three channels, bits. Blocks without any hold nothing there."""

ImageGradients = tuple[Float[Tensor, "H W C"], Float[Tensor, "H W 1"] | None]
"""By the blended channels side by side, and by alpha; None where it had no part."""


def no_way_back(*_: object) -> NoReturn:
    """The way back of a record that was made without ``Want.GRADIENTS``. Raises RuntimeError."""
    raise RuntimeError("this record has no way back; ask for it with Want.GRADIENTS")


@dataclass(frozen=True)
class LazyColors:
    """The channel "rgb", worked out row by row where the picture shows a row, and never for the others.

    ``checked`` is what the colours are made of: a rasterizer refuses it where it is not finite, seen or not. ``kernel``
    is what the compiled rasterizer asks; ``all_rows`` makes all colours at once, with the same bits.
    """

    checked: Float[Tensor, "N 3"]
    kernel: "_kernels.LazyColors"
    all_rows: Callable[[], Float[Tensor, "N 3"]]


@dataclass(frozen=True)
class KeptTiles:
    """What was blended, D - 1 channels and alpha, of the sixteen pixels of each of B blocks, tile by tile; those beyond
    the image as well. Blocks in which there is nothing have the first three channels and alpha alone, tiles in which
    there is nothing have alpha alone.

    ``room`` holds as many floats, for the way back to put gradients in. Both are the rasterizer's, for one step: once
    its way back has been gone they may be another view's.
    """

    values: Float[Tensor, "B D 16"]
    room: Float[Tensor, "R"]


@dataclass(frozen=True)
class TileShading:
    """A hint for the compiled rasterizer: ``kernel`` shades tiles as soon as they are blended.

    ``backward(tiles, grad_color, into)`` is the way back from the colour [H W 3] to what is kept of them, see
    :class:`Raster`; where it is None, what was blended must be kept as an image.
    """

    kernel: "_kernels.PictureShader"
    backward: Callable[[KeptTiles, Tensor, Gradients], TileGradients] | None = None


class Emission:
    """What every Gaussian emits towards one camera: C channels side by side, ``widths`` by name, in order.

    ``opacity_factor`` [N] multiplies the opacity, to more than 1 too where a step leaves Gaussians out (alpha at a
    pixel is bounded all the same), and is not blended. ``lazy`` is a hint that a rasterizer may ignore: then it takes
    ``channels``. ``backward(grad_channels, grad_opacity_factor, into)``: positions may get a gradient, which is added
    to that of the geometry.
    """

    def __init__(
        self,
        widths: Mapping[str, int],
        channels: Float[Tensor, "N C"] | LazyColors,
        opacity_factor: Float[Tensor, "N"] | None = None,
        backward: Callable[[Tensor, Tensor | None, Gradients], None] = no_way_back,
    ):
        self.widths, self._channels, self.opacity_factor = widths, channels, opacity_factor
        self.backward = backward

    @property
    def lazy(self) -> LazyColors | None:
        """Colours that need not be worked out for every row."""
        return self._channels if isinstance(self._channels, LazyColors) else None

    @computed_once
    def channels(self) -> Float[Tensor, "N C"]:
        """All of them, for every row."""
        return self._channels.all_rows() if isinstance(self._channels, LazyColors) else self._channels

    def named(self) -> Channels:
        """The channels by name."""
        return dict(zip(self.widths, self.channels.split(tuple(self.widths.values()), -1), strict=True))


@dataclass
class Footprint:
    """Where the Gaussians fell on the image; the way back fills in the gradients.

    ``radii`` are half-extents in pixels (x, y), 0 for Gaussians that were not drawn. ``means2d_gradient`` is
    dL/d(projected centre) in 1/pixels, ``absolute_gradient`` the per-axis sum over pixels of its absolute value
    (AbsGS; only when ``RasterOptions.absgrad``). Both are None before that.
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
    """One rasterization. ``image`` is blended over the background; memory may be planar, [C H W] permuted.

    ``shaded`` are the colours of the shader that the rasterizer was handed, if it took the hint; ``image`` may then be
    without channels, C = 0, where a mere picture was wanted. ``backward(grad_image, grad_alpha, into)``.

    ``tiles`` is what was blended where the hint has a way back. Then ``image`` has no channels either, and ``backward``
    takes :data:`TileGradients`.
    """

    image: Float[Tensor, "H W C"]
    alpha: Float[Tensor, "H W 1"]
    footprint: Footprint
    backward: Callable[[Tensor, Tensor | None, Gradients], EmissionGradients] = no_way_back
    shaded: Float[Tensor, "H W 3"] | None = None
    tiles: KeptTiles | None = None


@dataclass(frozen=True)
class Shaded:
    """The colour of each pixel. ``backward(grad_color, into)`` gives the gradients of blended channels and alpha."""

    color: Float[Tensor, "H W 3"]
    backward: Callable[[Tensor, Gradients], ImageGradients] = no_way_back


@dataclass(frozen=True)
class Rendering:
    """What a model shows of a batch: display-referred sRGB, nominally in [0, 1] (not clamped).

    A photograph or a crop is [H W 3], a lot of rays [R 3]. ``buffers`` are what was blended, by name, and "alpha";
    empty where a picture was shaded while it was blended, and where a training step asks for none. ``footprint`` says
    where Gaussians fell, of models that have any. ``backward(grad_color, grad_buffers)`` gives the gradients of all
    parameters that had a part. ``camera`` is that of a photograph or a crop that was splatted; rays have none.
    """

    color: Float[Tensor, "*pixels 3"]
    alpha: Float[Tensor, "*pixels 1"]
    buffers: Channels = field(default_factory=dict)
    footprint: Footprint | None = None
    backward: Callable[[Tensor, Mapping[str, Tensor]], Gradients] = no_way_back
    camera: Camera | None = None
