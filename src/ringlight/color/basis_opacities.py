"""A shared basis that moves opacities too: what shows from some sides only costs a Gaussian no number of its own.

Glossy-Gaussian (Zhang et al. 2025) gives each Gaussian fifteen numbers for how its opacity changes with the direction.
Here the weights that mix a Gaussian's colour mix that as well, of harmonics that all share, and add it to the logit:

    opacity(v) = sigmoid(logit + sum over k of weights_k (sum over j of o_kj Y_j(v)))

So who lowers the logit lowers the opacity from every side, and nothing is clamped.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ringlight import _kernels
from ringlight.color.by_torch import OPACITY_FACTOR, emitted_by_torch
from ringlight.color.harmonics import runs_native, sh_colors
from ringlight.color.shared_basis import BASIS, DC, WEIGHTS, SharedBasis, mixed_harmonics
from ringlight.core.camera import Camera
from ringlight.core.directions import view_directions
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import COLOR, COLUMNS, Gradients, dense
from ringlight.core.randomness import generator
from ringlight.core.rendering import Channels, Emission
from ringlight.core.sh_basis import MAX_DEGREE, basis_count, sh_basis
from ringlight.core.triton_kernels import runs_triton
from ringlight.core.want import Want

if TYPE_CHECKING:
    from ringlight.color.shared_basis_triton import BasisRows

OPACITY_BASIS = "opacity_basis"
"""The shared parameter."""

FIRST_DEVIATION = 1.2
"""Of its numbers at the start, in logits: four times that of the colours' basis. A first step of each weight by 5e-3
moves an opacity of a half by some 0.002."""

LEAST_MEAN = 1e-12
"""Opacity without a direction from which on that towards a camera is exact; of what is fainter it falls, so that a
factor stays a number."""


class BasisOpacities(SharedBasis):
    """Columns and ``basis`` of :class:`SharedBasis`; shared besides: ``opacity_basis`` [K 15], logits of opacity.

    ``active_degree`` counts for both. Raises RecipeError for a ``size`` K that the kernels do not take.
    """

    def __init__(self, size: int, seed: int = 0):
        super().__init__(size, seed)
        drawn = torch.randn(size, basis_count(MAX_DEGREE) - 1, generator=generator(seed, 0, OPACITY_BASIS))
        self.opacity_basis = nn.Parameter(FIRST_DEVIATION * drawn)

    def emit(self, gaussians: Gaussians, camera: Camera, names: Sequence[str], want: Want) -> Emission:
        """ "rgb" [N 3], clamped at black, and the opacity factor once the degree is above 0."""
        degree = int(self.active_degree)
        if not degree:
            return super().emit(gaussians, camera, names, want)
        columns = gaussians.columns()
        read = {name: columns[name] for name in ("means", "opacity_logits", DC, WEIGHTS)}
        if runs_triton(*read.values(), self.basis, self.opacity_basis):
            return self.by_triton(gaussians, camera, want)
        if runs_native(*read.values(), self.basis, self.opacity_basis):
            plain = super().emit(gaussians, camera, names, want)
            return with_varying_opacities(plain, gaussians, self, COLOR + OPACITY_BASIS, camera, want)

        def channels(columns: dict[str, Tensor]) -> Channels:
            means, logits, dc, weights = columns.values()
            rest = mixed_harmonics(weights, self.basis)
            factors = factors_reference(means, logits, weights, self.opacity_basis, camera.position, degree)
            return {"rgb": sh_colors(means, dc, rest, camera.position, degree), OPACITY_FACTOR: factors[:, None]}

        shared = {COLOR + BASIS: self.basis, COLOR + OPACITY_BASIS: self.opacity_basis}
        return emitted_by_torch(channels, read, shared, want)

    def rows(self, gaussians: Gaussians, constants: Float[Tensor, "N 3"], camera: Camera) -> "BasisRows":
        """With what moves the opacities, from degree 1 on."""
        plain = super().rows(gaussians, constants, camera)
        if not plain.degree:
            return plain
        from ringlight.color.shared_basis_triton import MovedOpacities

        logits, moves = gaussians.opacity_logits.contiguous(), self.opacity_basis.detach()
        return replace(plain, opacities=MovedOpacities(logits, moves, LEAST_MEAN))


@torch.no_grad()
def with_varying_opacities(
    plain: Emission, gaussians: Gaussians, varying: BasisOpacities, name: str, camera: Camera, want: Want
) -> Emission:
    """``plain``, by kernels, with the opacity factor of ``varying``, whose opacity basis has this ``name`` in a model.

    All is float32 on the CPU, and the degree above 0. ``plain.backward`` writes gradients of "means" and
    "basis_weights", which this adds to.
    """
    means, logits, weights = gaussians.means, gaussians.opacity_logits, gaussians.appearance[WEIGHTS]
    shared = varying.opacity_basis.detach()
    rows = (means, logits, weights, shared, camera.native, int(varying.active_degree), LEAST_MEAN)
    factors = torch.empty_like(logits)
    _kernels.sh_basis_opacity_factors(*rows, factors)
    if want is not Want.GRADIENTS:
        return Emission(plain.widths, plain.channels, factors)

    @torch.no_grad()
    def backward(grad_channels: Tensor, grad_factors: Tensor | None, into: Gradients) -> None:
        plain.backward(grad_channels, None, into)
        if grad_factors is None:
            return
        known, grad_shared = into.get(COLUMNS + "opacity_logits"), torch.empty_like(shared)
        grad_logits = torch.zeros_like(logits) if known is None else dense(known)
        grad_means, grad_weights = (dense(into[COLUMNS + column]) for column in ("means", WEIGHTS))
        _kernels.sh_basis_opacity_gradient(
            *rows, grad_factors.contiguous(), grad_means, grad_logits, grad_weights, grad_shared
        )
        into |= {
            COLUMNS + "means": grad_means,
            COLUMNS + "opacity_logits": grad_logits,
            COLUMNS + WEIGHTS: grad_weights,
        }
        into.add(name, grad_shared)

    return Emission(plain.widths, plain.channels, factors, backward)


def factors_reference(
    means: Float[Tensor, "N 3"],
    logits: Float[Tensor, "N"],
    weights: Float[Tensor, "N K"],
    shared: Float[Tensor, "K J"],
    position: Float[Tensor, "3"],
    degree: int,
) -> Float[Tensor, "N"]:
    """What the kernels compute, in any float dtype: the opacity towards a camera at ``position`` over the logit's."""
    basis = sh_basis(view_directions(means, position.to(means)), degree)[:, 1:]
    moved = (basis * (weights @ shared)[:, : basis.shape[1]]).sum(-1)
    return (logits + moved).sigmoid() / logits.sigmoid().clamp_min(LEAST_MEAN)
