"""Any view-dependent colour as spherical harmonics of degree 3, which every viewer understands.

For each Gaussian the colour is asked for from a set of cameras, usually the training cameras, and 16 coefficients a
channel are fitted by weighted ridge regression. The ridge is that of a smoothing spline on the sphere (Wahba 1981):
it grows with l (l + 1), the eigenvalue of the Laplacian, so that the side no camera saw stays tame.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.directions import view_directions
from ringlight.core.gaussians import Gaussians
from ringlight.core.sh_basis import GREY, basis_count, sh_basis
from ringlight.core.stages import counted

DEGREE = 3
COEFFICIENTS = basis_count(DEGREE)

RIDGE = 3e-5
"""Times l (l + 1) and the number of cameras: half a percent of the data term (1 / 4 pi a camera) at l = 3, so that
exact harmonics are recovered to about 0.001, while 24 cameras do not overfit and the unseen side does not run away."""

UNSEEN_WEIGHT = 0.01
"""Of a camera whose picture the Gaussian's centre misses: enough to steer, not enough to spoil what is seen."""

CHUNK_FLOATS = 1 << 25
"""Bound on the basis of one chunk of Gaussians, [n M 16]: 128 MB, about a third of the peak."""

ColorsFrom = Callable[[Gaussians, Camera], Tensor]
"""What the Gaussians show to a camera, [n 3] in [0, 1]; a colour model's "rgb" channel, for instance."""


@dataclass(frozen=True)
class Baked:
    """Harmonics as viewers use them: colour = max(0, 0.5 + sum), and how far they are from the colour asked for.

    ``rmse`` is over all Gaussians, channels and cameras that see them, in units of display-referred colour (0 to 1);
    ``worst`` is that of the worst single Gaussian. Cameras whose picture a centre misses are not counted.
    """

    sh_dc: Float[Tensor, "N 3"]
    sh_rest: Float[Tensor, "N 15 3"]
    rmse: float
    worst: float

    @property
    def psnr(self) -> float:
        """The error as a peak signal-to-noise ratio, dB; infinite for a perfect fit."""
        return -20 * math.log10(self.rmse) if self.rmse > 0 else math.inf


@torch.no_grad()
def bake_to_sh(gaussians: Gaussians, cameras: Sequence[Camera], colors_from: ColorsFrom) -> Baked:
    """Fit degree 3 to what ``colors_from`` returns for chunks of rows, seen from ``cameras`` (at least one).

    Memory is bounded by the chunk, not by the number of Gaussians; the result does not depend on the chunk.
    """
    if not cameras:
        raise ValueError("bake_to_sh needs at least one camera")
    rows = max(CHUNK_FLOATS // (COEFFICIENTS * len(cameras)), 1)
    parts = [
        _fit(gaussians.rows(torch.arange(begin, min(begin + rows, len(gaussians)))), cameras, colors_from)
        for begin in counted("baking colours", range(0, len(gaussians), rows))
    ]
    harmonics = torch.cat([part[0] for part in parts]) if parts else torch.zeros(0, COEFFICIENTS, 3)
    squares = torch.cat([part[1] for part in parts]) if parts else torch.zeros(0)
    views = torch.cat([part[2] for part in parts]) if parts else torch.zeros(0, dtype=torch.int64)
    each = (squares.double() / views.clamp_min(1)).sqrt()
    return Baked(
        sh_dc=harmonics[:, 0].contiguous(),
        sh_rest=harmonics[:, 1:].contiguous(),
        rmse=math.sqrt(squares.double().sum().item() / max(views.sum().item(), 1)),
        worst=each.max().item() if len(each) else 0.0,
    )


def _fit(
    gaussians: Gaussians, cameras: Sequence[Camera], colors_from: ColorsFrom
) -> tuple[Float[Tensor, "n 16 3"], Float[Tensor, "n"], Int[Tensor, "n"]]:
    """Of every row: coefficients, sum of squared errors (mean over channels) and number of the cameras that see it."""
    means = gaussians.means
    basis = torch.stack([sh_basis(view_directions(means, camera.position), DEGREE) for camera in cameras], 1)
    colors = torch.stack([colors_from(gaussians, camera) for camera in cameras], 1)
    seen = torch.stack([_sees(camera, means) for camera in cameras], 1)
    weights = torch.where(seen, 1.0, UNSEEN_WEIGHT)
    weighted = (basis * weights[..., None]).transpose(1, 2)
    normal = torch.bmm(weighted, basis) + RIDGE * len(cameras) * torch.diag(_laplacian())
    harmonics = torch.linalg.solve(normal, torch.bmm(weighted, colors - GREY))
    shown = (torch.bmm(basis, harmonics) + GREY).clamp_min(0)
    squares = ((shown - colors) ** 2).mean(-1)
    return harmonics, (squares * seen).sum(1), seen.sum(1)


def _sees(camera: Camera, means: Float[Tensor, "n 3"]) -> Bool[Tensor, "n"]:
    """Whether the centre falls into the picture."""
    x, y, depth = (means @ camera.world_to_camera[:3, :3].T + camera.world_to_camera[:3, 3]).unbind(1)
    front = depth > 0
    z = torch.where(front, depth, 1.0)
    u, v = x / z * camera.focal[0] + camera.center[0], y / z * camera.focal[1] + camera.center[1]
    return front & (u >= 0) & (u <= camera.width) & (v >= 0) & (v <= camera.height)


def _laplacian() -> Float[Tensor, "16"]:
    """l (l + 1) of each coefficient: 0 once, 2 three times, 6 five times, 12 seven times."""
    return torch.tensor([float(degree * (degree + 1)) for degree in range(DEGREE + 1) for _ in range(2 * degree + 1)])
