"""What Gaussians with a shared basis emit on a GPU, and a mirror's other channels beside it, by Triton's kernels."""

from collections.abc import Mapping

import torch
from torch import Tensor

from ringlight.color.basis_opacities import OPACITY_BASIS
from ringlight.color.mirror_triton import surface_gradients, write_surface
from ringlight.color.shared_basis import BASIS, DC, WEIGHTS
from ringlight.color.shared_basis_triton import RGB, BasisGradients, BasisRows
from ringlight.core.camera import Camera
from ringlight.core.gradients import COLOR, COLUMNS, Gradients
from ringlight.core.rendering import Emission
from ringlight.core.want import Want

NAMES = {
    "means": COLUMNS + "means",
    "constants": COLUMNS + DC,
    "weights": COLUMNS + WEIGHTS,
    "basis": COLOR + BASIS,
    "logits": COLUMNS + "opacity_logits",
    "moves": COLOR + OPACITY_BASIS,
}
"""Of the gradients, by the fields of :class:`BasisGradients`."""


@torch.no_grad()
def emission_of_basis(rows: BasisRows, want: Want) -> Emission:
    """ "rgb" [N 3], clamped at black, and the opacity factor where opacities vary."""
    channels = rows.means.new_empty(len(rows.means), RGB)
    factors = rows.emit(channels)
    if want is not Want.GRADIENTS:
        return Emission({"rgb": RGB}, channels, factors)

    @torch.no_grad()
    def backward(grad_channels: Tensor, grad_factors: Tensor | None, into: Gradients) -> None:
        into.add_all(_named(rows.gradients(channels, grad_channels.contiguous(), grad_factors), NAMES))

    return Emission({"rgb": RGB}, channels, factors, backward)


@torch.no_grad()
def emission_of_mirror(
    rows: BasisRows,
    surface: Mapping[str, Tensor],
    turned: tuple[float, float],
    camera: Camera,
    widths: Mapping[str, int],
    names: Mapping[str, str],
    want: Want,
) -> Emission:
    """The same with the columns of ``surface``, normals and latents by name, behind the colour. ``turned`` is from
    which cosine on normals are turned round, and the smallest length of a direction; ``names`` as NAMES."""
    normals, latents = (column.contiguous() for column in surface.values())
    channels = rows.means.new_empty(len(rows.means), sum(widths.values()))
    factors = rows.emit(channels)
    write_surface(rows.means, normals, latents, camera, *turned, channels)
    if want is not Want.GRADIENTS:
        return Emission(widths, channels, factors)

    @torch.no_grad()
    def backward(grad_channels: Tensor, grad_factors: Tensor | None, into: Gradients) -> None:
        upstream = grad_channels.contiguous()
        found = rows.gradients(channels, upstream, grad_factors)
        others = surface_gradients(rows.means, normals, latents, camera, *turned, upstream, found.means)
        into.add_all(_named(found, names))
        into.add_all({COLUMNS + name: gradient for name, gradient in zip(surface, others, strict=True)})

    return Emission(widths, channels, factors, backward)


@torch.no_grad()
def emission_of_plain_mirror(
    columns: Mapping[str, Tensor], turned: tuple[float, float], camera: Camera, widths: Mapping[str, int], want: Want
) -> Emission:
    """Of a mirror whose base colours do not vary; ``columns`` are means, base, normals and latents by name."""
    means, base, normals, latents = (column.contiguous() for column in columns.values())
    channels = means.new_empty(len(means), sum(widths.values()))
    channels[:, :RGB] = base.sigmoid()
    write_surface(means, normals, latents, camera, *turned, channels)
    if want is not Want.GRADIENTS:
        return Emission(widths, channels)

    @torch.no_grad()
    def backward(grad_channels: Tensor, _: Tensor | None, into: Gradients) -> None:
        upstream, by_means = grad_channels.contiguous(), torch.zeros_like(means)
        by_base = torch.ops.aten.sigmoid_backward(upstream[:, :RGB], channels[:, :RGB])
        others = surface_gradients(means, normals, latents, camera, *turned, upstream, by_means)
        found = zip(columns, (by_means, by_base, *others), strict=True)
        into.add_all({COLUMNS + name: gradient for name, gradient in found})

    return Emission(widths, channels, backward=backward)


def _named(found: BasisGradients, names: Mapping[str, str]) -> dict[str, Tensor]:
    return {names[field]: gradient for field, gradient in vars(found).items() if gradient is not None}
