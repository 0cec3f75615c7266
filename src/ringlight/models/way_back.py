"""From the gradient of a picture to those of all parameters: the seams between colour model, rasterizer and shader."""

from collections.abc import Iterable, Mapping, Sequence
from functools import partial

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.gradients import COLUMNS, Gradients, dense
from ringlight.core.rendering import Channels, Emission, EmissionGradients, Raster, Shaded, TileShading

ALPHA = "alpha"
"""The buffer that is always there."""

FAINTEST_REST = 1e-6
"""Least share of light that a row lets through: opacities are floats, and beyond it they are one."""


def named_parts(raster: Raster, names: Sequence[str], widths: Sequence[int]) -> Channels:
    """What was blended, by name, sharing memory, and "alpha"."""
    return dict(zip(names, raster.image.split(list(widths), -1), strict=True)) | {ALPHA: raster.alpha}


def ordered(emission: Emission, names: Sequence[str]) -> Emission:
    """The same with exactly the channels ``names`` in this order; itself where it is that already."""
    if tuple(emission.widths) == tuple(names):
        return emission
    count = sum(emission.widths.values())
    numbers = torch.arange(count, device=emission.channels.device).split(list(emission.widths.values()))
    places = dict(zip(emission.widths, numbers, strict=True))
    index = torch.cat([places[name] for name in names])

    def backward(grad_channels: Tensor, grad_opacity_factor: Tensor | None, into: Gradients) -> None:
        whole = grad_channels.new_zeros(len(grad_channels), count).index_copy_(1, index, grad_channels)
        emission.backward(whole, grad_opacity_factor, into)

    widths = {name: emission.widths[name] for name in names}
    return Emission(widths, emission.channels[:, index], emission.opacity_factor, backward)


def with_factors(emission: Emission, factors: Float[Tensor, "N"]) -> Emission:
    """The same with opacities multiplied by these constants too."""
    own = emission.opacity_factor

    def backward(grad_channels: Tensor, grad_opacity_factor: Tensor | None, into: Gradients) -> None:
        by_own = None if own is None or grad_opacity_factor is None else grad_opacity_factor * factors
        emission.backward(grad_channels, by_own, into)

    channels = emission.lazy or emission.channels
    return Emission(emission.widths, channels, factors if own is None else own * factors, backward)


def shaded_in_tiles(raster: Raster, tiles: TileShading | None) -> Shaded:
    """What ``tiles`` made of the raster while it was blended; the way back is that of the kept tiles."""
    assert raster.shaded is not None
    assert raster.tiles is not None
    assert tiles is not None
    assert tiles.backward is not None
    return Shaded(raster.shaded, partial(tiles.backward, raster.tiles))


class WayBack:
    """See :class:`ringlight.core.rendering.Rendering`. Once gone it lets go of what it needed.

    It is that of the ``parameters`` as they were drawn: one that was changed in place since is refused.
    """

    def __init__(
        self,
        emission: Emission,
        raster: Raster,
        shaded: Shaded,
        widths: Mapping[str, int],
        parameters: Iterable[Tensor],
    ):
        self._parts: tuple[Emission, Raster, Shaded] | None = (emission, raster, shaded)
        self._names, self._widths = tuple(widths), tuple(widths.values())
        self._versions = [(parameter, parameter._version) for parameter in parameters]

    @torch.no_grad()
    def __call__(self, grad_color: Float[Tensor, "H W 3"], grad_buffers: Mapping[str, Tensor]) -> Gradients:
        emission, raster, shaded = self._taken()
        into = Gradients()
        emission.backward(*self._to_emission(raster, shaded, grad_color, grad_buffers, into), into)
        return into

    @torch.no_grad()
    def to_opacities(
        self, grad_color: Float[Tensor, "H W 3"], opacity_logits: Float[Tensor, "N"]
    ) -> Float[Tensor, "N"]:
        """The way back that ends before the colour model, for whoever wants no more than opacities.

        The gradient by the logarithm of each row's opacity towards the camera: alpha times the derivative by alpha,
        summed over the pixels. ``opacity_logits`` are those that were drawn.
        """
        emission, raster, shaded = self._taken()
        into = Gradients()
        _, by_factor = self._to_emission(raster, shaded, grad_color, {}, into)
        if emission.opacity_factor is not None:
            assert by_factor is not None, "a rasterizer gives a gradient by each factor"
            return emission.opacity_factor * by_factor
        by_logit = into.get(COLUMNS + "opacity_logits")
        if by_logit is None:  # a picture may show nothing
            return torch.zeros_like(opacity_logits)
        # By the logit the opacity's logarithm moves by 1 - opacity.
        return dense(by_logit) / (-opacity_logits).sigmoid().clamp_min(FAINTEST_REST)

    def _taken(self) -> tuple[Emission, Raster, Shaded]:
        """The parts, once, if the parameters are still those that were drawn."""
        if self._parts is None:
            raise RuntimeError("the way back of this picture has been gone already; render it again")
        if any(parameter._version != version for parameter, version in self._versions):
            raise RuntimeError("parameters were changed after this picture was rendered; render it again")
        parts, self._parts, self._versions = self._parts, None, []
        return parts

    def _to_emission(
        self,
        raster: Raster,
        shaded: Shaded,
        grad_color: Float[Tensor, "H W 3"],
        grad_buffers: Mapping[str, Tensor],
        into: Gradients,
    ) -> EmissionGradients:
        grad_image, grad_alpha = shaded.backward(grad_color, into)
        if raster.tiles is None:
            unread = sum(self._widths) - grad_image.shape[-1]
            if unread:
                grad_image = torch.nn.functional.pad(grad_image, (0, unread))
            if grad_buffers:
                grad_image, grad_alpha = self._with_buffers(grad_image, grad_alpha, grad_buffers)
        elif grad_buffers:
            name = next(iter(grad_buffers))
            raise RuntimeError(f"no buffers were asked for, and {name!r} has a gradient; ask for it")
        return raster.backward(grad_image, grad_alpha, into)

    def _with_buffers(
        self, grad_image: Float[Tensor, "H W C"], grad_alpha: Tensor | None, grad_buffers: Mapping[str, Tensor]
    ) -> tuple[Float[Tensor, "H W C"], Float[Tensor, "H W 1"] | None]:
        total = grad_image.clone()
        parts = dict(zip(self._names, total.split(list(self._widths), -1), strict=True))
        for name, gradient in grad_buffers.items():
            if name != ALPHA:
                parts[name] += gradient
        of_alpha = grad_buffers.get(ALPHA)
        if of_alpha is None or grad_alpha is None:
            return total, of_alpha if grad_alpha is None else grad_alpha
        return total, grad_alpha + of_alpha
