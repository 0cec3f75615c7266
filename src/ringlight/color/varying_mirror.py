"""What Gaussians emit for deferred reflection shading where their base colour changes with the view as well.

A reflection of the surroundings is the same function of the reflected direction all over a mirror, and the shader knows
it. What one ball shows of the next one is not. A few weights for each Gaussian, of harmonics that all share, hold what
is left: smooth, and of its own place (``color/shared_basis.py``). They may move opacities too
(``color/basis_opacities.py``).
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight import _kernels
from ringlight.color.basis_opacities import OPACITY_BASIS, BasisOpacities, with_varying_opacities
from ringlight.color.mirror import FLIP_BELOW, NORMALS, Mirror, mirror_view
from ringlight.color.ringlight import BASE, LATENTS
from ringlight.color.shared_basis import BASIS, DC, WEIGHTS, SharedBasis
from ringlight.core.camera import Camera
from ringlight.core.directions import SMALLEST_LENGTH
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import COLOR, COLUMNS, Gradients, dense
from ringlight.core.rendering import Channels, Emission
from ringlight.core.scene import PointCloud
from ringlight.core.sh_basis import C0, sh_from_rgb
from ringlight.core.triton_kernels import runs_triton
from ringlight.core.want import Want

VARYING = "varying."
"""What the names of the shared parameters begin with."""

OPACITY_BASES = (COLOR + OPACITY_BASIS, COLOR + VARYING + OPACITY_BASIS)
"""What moves opacities in models of either kind."""

OUR_NAMES = {COLOR + name: COLOR + VARYING + name for name in (BASIS, OPACITY_BASIS)}
"""Of what is shared, by what the basis calls it."""

RGB = 3
"""Channels of the colour, which come first."""


class VaryingMirror(Mirror):
    """A :class:`Mirror` whose "rgb" is max(0, sigmoid(base) + what ``basis_weights`` [N K] mix of harmonics).

    Shared: ``varying``, a :class:`SharedBasis` of K functions; its degree grows during training. With ``opacities`` it
    is a :class:`BasisOpacities`, whose opacity factor is emitted from degree 1 on. What the shader adds comes on top.
    Raises RecipeError for a ``basis_size`` K that the kernels do not take.
    """

    def __init__(self, latents: int, basis_size: int, seed: int = 0, opacities: bool = False):
        super().__init__(latents, seed)
        self.varying = (BasisOpacities if opacities else SharedBasis)(basis_size, seed)

    def new_columns(self, points: PointCloud) -> dict[str, Tensor]:
        """Those of a mirror, and weights of zero."""
        return super().new_columns(points) | {WEIGHTS: self.varying.new_columns(points)[WEIGHTS]}

    def emit(self, gaussians: Gaussians, camera: Camera, names: Sequence[str], want: Want) -> Emission:
        """See :meth:`Mirror.emit`; "rgb" may exceed 1. With an opacity factor where opacities vary."""
        columns = {"means": gaussians.means}
        columns |= {name: gaussians.appearance[name] for name in (BASE, NORMALS, LATENTS, WEIGHTS)}
        varying, degree = self.varying, int(self.varying.active_degree)
        if list(names) != ["rgb"] and runs_triton(*columns.values(), varying.basis):
            return self._by_triton(gaussians, camera, want)
        if list(names) != ["rgb"] and self.runs_native([*columns.values(), varying.basis]):
            lit = _native_emission(columns, varying.basis, degree, camera, self.emits, want)
            if not isinstance(varying, BasisOpacities) or not degree:
                return lit
            return with_varying_opacities(lit, gaussians, varying, COLOR + VARYING + OPACITY_BASIS, camera, want)
        plain = super().emit(gaussians, camera, names, want)
        colors = self.varying.emit(self._on_basis(gaussians), camera, ("rgb",), want)
        channels = torch.cat([colors.channels, plain.channels[:, RGB:]], -1)
        if want is not Want.GRADIENTS:
            return Emission(plain.widths, channels, colors.opacity_factor)

        def backward(grad_channels: Tensor, grad_factor: Tensor | None, into: Gradients) -> None:
            found = Gradients()
            colors.backward(grad_channels[:, :RGB].contiguous(), grad_factor, found)
            into.add_all(_by_our_names(found))
            reached = grad_channels.clone()  # the base colour's part: nothing where the sum is clamped
            reached[:, :RGB] = dense(found[COLUMNS + DC]) / C0
            plain.backward(reached, None, into)

        return Emission(plain.widths, channels, colors.opacity_factor, backward)

    def _by_triton(self, gaussians: Gaussians, camera: Camera, want: Want) -> Emission:
        """The same on a GPU."""
        from ringlight.color import basis_emission

        rows = self.varying.rows(gaussians, gaussians.appearance[BASE], camera)
        surface = {name: gaussians.appearance[name] for name in (NORMALS, LATENTS)}
        turned = (FLIP_BELOW, SMALLEST_LENGTH)
        names = {field: OUR_NAMES.get(name, name) for field, name in basis_emission.NAMES.items()}
        names["constants"] = COLUMNS + BASE
        lit = replace(rows, by_logits=True)
        return basis_emission.emission_of_mirror(lit, surface, turned, camera, self.emits, names, want)

    @torch.no_grad()
    def _on_basis(self, gaussians: Gaussians) -> Gaussians:
        """The same rows as the shared basis knows them: the base colour as a constant coefficient."""
        base, weights = gaussians.appearance[BASE].sigmoid(), gaussians.appearance[WEIGHTS]
        return replace(gaussians, appearance={DC: sh_from_rgb(base), WEIGHTS: weights})


@torch.no_grad()
def _native_emission(
    columns: dict[str, Tensor],
    basis: Float[Tensor, "K 15 3"],
    degree: int,
    camera: Camera,
    widths: Mapping[str, int],
    want: Want,
) -> Emission:
    """The same with every channel by two kernels there and two back, none of which writes what another one copies."""
    view, native, basis = mirror_view(camera), camera.native, basis.detach()
    means, base, *others, weights = (column.contiguous() for column in columns.values())
    plain, count = [means, base, *others], len(means)
    colors, channels = torch.empty_like(means), means.new_empty(count, sum(widths.values()))
    slopes = means.new_empty(_kernels.sh_slopes(count)) if want is Want.GRADIENTS else None
    _kernels.sh_basis_colors(means, base, weights, basis, native, degree, colors, slopes, by_logits=True)
    _kernels.mirror_channels(view, plain, channels, colors)
    if slopes is None:
        return Emission(widths, channels)

    @torch.no_grad()
    def backward(grad_channels: Tensor, _: Tensor | None, into: Gradients) -> None:
        gradients = [torch.empty_like(column) for column in plain]
        by_constant, of_weights, of_basis = (torch.empty_like(tensor) for tensor in (colors, weights, basis))
        _kernels.mirror_gradient(view, plain, grad_channels, gradients, (colors, slopes, by_constant))
        _kernels.sh_basis_gradient(means, native, degree, by_constant, weights, basis, of_weights, of_basis)
        found = dict(zip(columns, [*gradients, of_weights], strict=True))
        into.add_all({COLUMNS + name: gradient for name, gradient in found.items()})
        into.add(COLOR + VARYING + BASIS, of_basis)

    return Emission(widths, channels, backward=backward)


def _by_our_names(found: Gradients) -> Gradients:
    """What the basis calls ``color.…`` is ``color.varying.…``; its constant coefficient is none of ours."""
    return Gradients({OUR_NAMES.get(name, name): value for name, value in found.items() if name != COLUMNS + DC})


def varying_channels_reference(
    columns: dict[str, Float[Tensor, "N c"]], basis: Float[Tensor, "K 15 3"], camera: Camera, degree: int
) -> Channels:
    """What is emitted, in torch and in any precision, from the columns by name."""
    from ringlight.color.harmonics import sh_colors_reference
    from ringlight.color.mirror import mirror_channels_reference
    from ringlight.color.shared_basis import mixed_harmonics

    plain = mirror_channels_reference(columns, camera)
    rest = mixed_harmonics(columns[WEIGHTS], basis)
    dc = sh_from_rgb(plain["rgb"])
    return plain | {"rgb": sh_colors_reference(columns["means"], dc, rest, camera.position, degree)}
