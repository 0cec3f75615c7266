"""Harmonics of a lower degree that look most alike from the training cameras: where a distillation begins.

To leave out the higher harmonics is best where a Gaussian is seen from everywhere, for they are orthogonal. Cameras are
few and on one side, and what they see of a higher harmonic is mostly what lower ones can show
(docs/methods/light-gaussian.md).
"""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.directions import view_directions
from ringlight.core.sh_basis import MAX_DEGREE, basis_count, sh_basis

RIDGE = 1e-3
"""Times the number of cameras: an eightieth of what each harmonic has over the sphere, 1 / 4 pi a camera, so that
little but what the cameras see is changed."""

BLOCK_ROWS = 1 << 14
"""Rows at once: normal equations of degree 2 take 16 MB."""


@torch.no_grad()
def narrowed_harmonics(
    means: Float[Tensor, "N 3"],
    dc: Float[Tensor, "N 3"],
    rest: Float[Tensor, "N K 3"],
    degree: int,
    cameras: Sequence[Camera],
) -> tuple[Float[Tensor, "N 3"], Float[Tensor, "N K 3"]]:
    """Constant and other coefficients without those above ``degree``: least squares over the ``cameras``, at least one.

    Every step works row by row, in double precision: neither threads nor the order of rows change a bit.
    """
    kept, new_dc, new_rest = basis_count(degree), dc.clone(), rest.clone()
    new_rest[:, kept - 1 :] = 0
    if rest.shape[1] < kept:
        return new_dc, new_rest
    stored = next(of for of in range(MAX_DEGREE + 1) if basis_count(of) == rest.shape[1] + 1)
    for rows in torch.arange(len(means), device=means.device).split(BLOCK_ROWS):
        matrix = RIDGE * len(cameras) * torch.eye(kept, dtype=torch.float64, device=means.device)
        system = torch.zeros(len(rows), kept, kept + 3, dtype=torch.float64, device=means.device)
        system[..., :kept] = matrix
        cut = rest[rows, kept - 1 :].double()
        for camera in cameras:
            directions = view_directions(means[rows].double(), camera.position.to(system))
            basis = sh_basis(directions, stored)
            seen = (basis[:, kept:, None] * cut).sum(1)
            system += basis[:, :kept, None] * torch.cat([basis[:, :kept], seen], 1)[:, None]
        added = _solved(system).float()
        new_dc[rows] += added[:, 0]
        new_rest[rows, : kept - 1] += added[:, 1:]
    return new_dc, new_rest


def _solved(system: Float[Tensor, "n k k+3"]) -> Float[Tensor, "n k 3"]:
    """x of A x = b for each row's [A b], A positive definite: elimination without pivots (Golub and Van Loan, "Matrix
    Computations", section 4.2), which loses what ``system`` held."""
    size = system.shape[1]
    for k in range(size):
        system[:, k, k:] /= system[:, k, k : k + 1].clone()
        below = system[:, k + 1 :, k : k + 1].clone()
        system[:, k + 1 :, k:] -= below * system[:, k : k + 1, k:]
    for k in range(size - 1, 0, -1):
        system[:, :k, size:] -= system[:, :k, k : k + 1] * system[:, k : k + 1, size:]
    return system[..., size:]
