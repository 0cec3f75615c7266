"""A grid of components as products of its factors: planes times lines, or three lines.

TensoRF (Chen, Xu, Geiger, Yu, Su, ECCV 2022), section 3: "VM" (vector-matrix) and "CP" (canonical polyadic).
"""

from typing import Literal

import torch
import torch.nn.functional
from jaxtyping import Float
from torch import Tensor, nn

from ringlight.volume.contract import Sides

Decomposition = Literal["vm", "cp"]

PAIRS = (((0, 1), 2), ((0, 2), 1), ((1, 2), 0))
"""Axes of each plane, and of the line that goes with it; a plane's rows are of its second axis."""

FIRST_DEVIATION = {"vm": 0.1, "cp": 0.2}
"""Standard deviation of planes and lines at the start (TensoRF, and its program for three lines)."""


class Factors(nn.Module):
    """``M`` components for each pair ("vm", 3M together), or M in all ("cp").

    "vm": ``planes.k`` [S_b S_a M] and ``lines.k`` [S_c M] for the axes (a, b), c of PAIRS. "cp": ``lines.k`` [S_k M].
    """

    def __init__(self, kind: Decomposition, sides: Sides, components: int, generator: torch.Generator):
        super().__init__()
        self.kind, self.components = kind, components

        def noise(*shape: int) -> nn.Parameter:
            return nn.Parameter(torch.empty(shape).normal_(0, FIRST_DEVIATION[kind], generator=generator))

        self.planes = nn.ParameterList()
        self.lines = nn.ParameterList()
        if kind == "cp":
            self.lines.extend([noise(side, components) for side in sides])
            return
        for (a, b), c in PAIRS:
            self.planes.append(noise(sides[b], sides[a], components))
            self.lines.append(noise(sides[c], components))

    @property
    def width(self) -> int:
        """Components of a point."""
        return self.components * (1 if self.kind == "cp" else len(PAIRS))

    @property
    def sides(self) -> Sides:
        """Nodes along x, y and z."""
        x, y, z = self.lines if self.kind == "cp" else reversed(list(self.lines))
        return len(x), len(y), len(z)

    def forward(self, points: Float[Tensor, "N 3"]) -> Float[Tensor, "N C"]:
        """The components at points in [0, 1]^3, linear between nodes."""
        if self.kind == "cp":
            x, y, z = (on_line(line, points[:, axis]) for axis, line in enumerate(self.lines))
            return x * y * z
        products = [
            on_plane(plane, points[:, a], points[:, b]) * on_line(line, points[:, c])
            for plane, line, ((a, b), c) in zip(self.planes, self.lines, PAIRS, strict=True)
        ]
        return torch.cat(products, -1)

    @torch.no_grad()
    def resize(self, sides: Sides) -> None:
        """Nodes in between are interpolated linearly."""
        for k, line in enumerate(list(self.lines)):
            axis = k if self.kind == "cp" else PAIRS[k][1]
            self.lines[k] = nn.Parameter(_stretched(line[None], (1, sides[axis]))[0])
        for k, plane in enumerate(list(self.planes)):
            a, b = PAIRS[k][0]
            self.planes[k] = nn.Parameter(_stretched(plane, (sides[b], sides[a])))

    @torch.no_grad()
    def crop(self, first: Sides, last: Sides) -> None:
        """See :class:`ringlight.volume.contract.VolumeField`."""

        def kept(axis: int) -> slice:
            return slice(first[axis], last[axis] + 1)

        for k, line in enumerate(list(self.lines)):
            self.lines[k] = nn.Parameter(line[kept(k if self.kind == "cp" else PAIRS[k][1])].clone())
        for k, plane in enumerate(list(self.planes)):
            a, b = PAIRS[k][0]
            self.planes[k] = nn.Parameter(plane[kept(b), kept(a)].contiguous())


def on_line(line: Float[Tensor, "S M"], at: Float[Tensor, "N"]) -> Float[Tensor, "N M"]:
    """Linear between nodes; ``at`` in [0, 1], clamped."""
    low, share = _cell(at, len(line))
    return torch.lerp(line[low], line[low + 1], share[:, None])


def on_plane(plane: Float[Tensor, "B A M"], at_a: Float[Tensor, "N"], at_b: Float[Tensor, "N"]) -> Float[Tensor, "N M"]:
    """Bilinear between nodes."""
    (low_a, share_a), (low_b, share_b) = _cell(at_a, plane.shape[1]), _cell(at_b, plane.shape[0])
    first = torch.lerp(plane[low_b, low_a], plane[low_b, low_a + 1], share_a[:, None])
    second = torch.lerp(plane[low_b + 1, low_a], plane[low_b + 1, low_a + 1], share_a[:, None])
    return torch.lerp(first, second, share_b[:, None])


def _cell(at: Float[Tensor, "N"], side: int) -> tuple[Tensor, Tensor]:
    """The node before each place, and the share of the way to the next."""
    place = at.clamp(0, 1) * (side - 1)
    low = place.detach().floor().clamp_max(side - 2)
    return low.long(), place - low


def _stretched(rows: Float[Tensor, "B A M"], size: tuple[int, int]) -> Float[Tensor, "b a M"]:
    planar = rows.permute(2, 0, 1)[None]
    wide = torch.nn.functional.interpolate(planar, size=size, mode="bilinear", align_corners=True)
    return wide[0].permute(1, 2, 0).contiguous()
