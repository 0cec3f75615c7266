"""Harmonics of which each Gaussian stores only a few numbers: how much of each shared function of the direction it has.

3DGS stores 45 coefficients for how a Gaussian's colour changes with the direction. Here they are a matrix product, N x
K weights by K shared rows of 45: the tensor of coefficients, Gaussians by harmonics by colours, of rank K. Unlike in
the tensor ring (RingLight-GS) the core of the place is the Gaussian's own row, so that neighbours may differ, and all
is linear: nothing saturates, and viewers that know harmonics show it exactly.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ringlight import _kernels
from ringlight.color.by_torch import emitted_by_torch
from ringlight.color.contract import Harmonics
from ringlight.color.harmonics import SphericalHarmonics, runs_native, sh_colors
from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import COLOR, COLUMNS, Gradients, dense
from ringlight.core.kernel_limits import SH_MAX_BASIS
from ringlight.core.randomness import generator
from ringlight.core.rendering import Channels, Emission
from ringlight.core.scene import DARKEST, PointCloud
from ringlight.core.sh_basis import MAX_DEGREE, basis_count, sh_from_rgb
from ringlight.core.triton_kernels import runs_triton
from ringlight.core.want import Want
from ringlight.errors import RecipeError

if TYPE_CHECKING:
    from ringlight.color.shared_basis_triton import BasisRows

DC, WEIGHTS, BASIS = "sh_dc", "basis_weights", "basis"
"""Columns, and the shared parameter."""

FIRST_DEVIATION = 0.3
"""Of the shared functions' coefficients at the start. Weights start at zero, so that nothing shows of them then, and a
first step of each moves a colour by their rate times about the deviation."""


class SharedBasis(SphericalHarmonics):
    """Columns "sh_dc" [N 3], the constant coefficient, and "basis_weights" [N K]; shared: ``basis`` [K 15 3].

    What it shows of a Gaussian is harmonics of degree 3; only how their coefficients are stored is another.
    colour(v) = 0.5 + C0 sh_dc + sum over k of weights_k (sum over j of basis_kj Y_j(v)), clamped at black.
    ``active_degree`` grows during training as in 3DGS; harmonics above it are not shown and get no gradient.
    Raises RecipeError for a ``size`` K that the kernels do not take.
    """

    def __init__(self, size: int, seed: int = 0):
        super().__init__(MAX_DEGREE)
        if not 1 <= size <= SH_MAX_BASIS:
            raise RecipeError(f"basis_size is {size}; give 1 to {SH_MAX_BASIS} functions of the direction")
        drawn = torch.randn(size, basis_count(MAX_DEGREE) - 1, 3, generator=generator(seed, 0, BASIS))
        self.basis = nn.Parameter(FIRST_DEVIATION * drawn)

    def new_columns(self, points: PointCloud) -> dict[str, Tensor]:
        """The points' own colours, the same from every side; no channel starts at black, where it would not learn."""
        weights = torch.zeros(len(points.colors), len(self.basis), device=points.colors.device)
        return {DC: sh_from_rgb(points.colors.clamp_min(DARKEST)), WEIGHTS: weights}

    def emit(self, gaussians: Gaussians, camera: Camera, names: Sequence[str], want: Want) -> Emission:
        """ "rgb" [N 3], clamped at black."""
        lit = LitByBasis(
            gaussians.means, gaussians.appearance[DC], gaussians.appearance[WEIGHTS], self.basis,
            int(self.active_degree),
        )  # fmt: skip
        if runs_triton(lit.means, lit.dc, lit.weights, lit.basis):
            return self.by_triton(gaussians, camera, want)
        if runs_native(lit.means, lit.dc, lit.weights, lit.basis):
            return _native_emission(lit, camera.native, want)

        def colors(columns: dict[str, Tensor]) -> Channels:
            means, dc, weights = columns.values()
            rest = mixed_harmonics(weights, self.basis)
            return {"rgb": sh_colors(means, dc, rest, camera.position, lit.degree)}

        columns = {"means": lit.means, DC: lit.dc, WEIGHTS: lit.weights}
        return emitted_by_torch(colors, columns, {COLOR + BASIS: self.basis}, want)

    def by_triton(self, gaussians: Gaussians, camera: Camera, want: Want) -> Emission:
        """The same on a GPU."""
        from ringlight.color.basis_emission import emission_of_basis

        return emission_of_basis(self.rows(gaussians, gaussians.appearance[DC], camera), want)

    def rows(self, gaussians: Gaussians, constants: Float[Tensor, "N 3"], camera: Camera) -> "BasisRows":
        """What Triton's kernels read."""
        from ringlight.color.shared_basis_triton import BasisRows

        columns = gaussians.means, constants, gaussians.appearance[WEIGHTS]
        means, constants, weights = (column.contiguous() for column in columns)
        basis, degree = self.basis.detach(), int(self.active_degree)
        return BasisRows(means, constants, weights, basis, camera.position, degree)

    @torch.no_grad()
    def harmonics(self, gaussians: Gaussians) -> Harmonics:
        """Written out; those above the active degree, which are not shown, are zero."""
        rest = mixed_harmonics(gaussians.appearance[WEIGHTS], self.basis)
        rest[:, basis_count(int(self.active_degree)) - 1 :] = 0
        return Harmonics(gaussians.appearance[DC], rest)


def mixed_harmonics(weights: Float[Tensor, "N K"], basis: Float[Tensor, "K J 3"]) -> Float[Tensor, "N J 3"]:
    """What the CPU's kernels mix and never write down."""
    return (weights @ basis.flatten(1)).unflatten(1, basis.shape[1:])


@dataclass(frozen=True)
class LitByBasis:
    """What the colours are made of; harmonics up to ``degree`` count."""

    means: Float[Tensor, "N 3"]
    dc: Float[Tensor, "N 3"]
    weights: Float[Tensor, "N K"]
    basis: Float[Tensor, "K J 3"]
    degree: int


@torch.no_grad()
def _native_emission(lit: LitByBasis, camera: _kernels.Camera, want: Want) -> Emission:
    means, basis = lit.means, lit.basis.detach()
    colors = torch.empty_like(means)
    slopes = means.new_empty(_kernels.sh_slopes(len(means))) if want is Want.GRADIENTS else None
    _kernels.sh_basis_colors(means, lit.dc, lit.weights, basis, camera, lit.degree, colors, slopes)
    if slopes is None:
        return Emission({"rgb": 3}, colors)

    @torch.no_grad()
    def backward(grad_channels: Tensor, _: Tensor | None, into: Gradients) -> None:
        known = into.get(COLUMNS + "means")
        grad_means = torch.empty_like(means) if known is None else dense(known)
        grad_dc, grad_weights, grad_basis = (torch.empty_like(tensor) for tensor in (lit.dc, lit.weights, basis))
        _kernels.sh_gradient(grad_channels, colors, slopes, grad_means, grad_dc, known is not None)
        _kernels.sh_basis_gradient(means, camera, lit.degree, grad_dc, lit.weights, basis, grad_weights, grad_basis)
        into[COLUMNS + "means"] = grad_means
        into.add_all({COLUMNS + DC: grad_dc, COLUMNS + WEIGHTS: grad_weights, COLOR + BASIS: grad_basis})

    return Emission({"rgb": 3}, colors, backward=backward)
