"""Settings of the light fields; free of torch, so that the command line can print them at once."""

import math
from dataclasses import dataclass
from typing import Literal

from ringlight.core.later import later
from ringlight.errors import RecipeError

LARGEST = {
    "rank": 128,
    "features": 1024,
    "bands": 24,
    "view_bands": 24,
    "head_hidden": 1024,
    "position_nodes": 65_536,
    "view_nodes": 512,
}
"""Far beyond what was ever of use. They keep a damaged or hostile model file from asking for all the memory."""

LARGEST_TABLES = 1 << 28
"""Floats of all heads at their nodes. No shape in a model file shows this number."""


@dataclass(frozen=True)
class RingSettings:
    """The neural tensor ring over (x, y, z, v): a_c = Trace(H_x(x) H_y(y) H_z(z) H_v(v) G_c)."""

    rank: int = 16
    """Rows and columns R of every matrix in the ring."""
    features: int = 48
    """Channels C of the appearance feature."""
    bands: int = 10
    """Fourier bands of each position coordinate."""
    view_bands: int = 10
    """Fourier bands of each component of the viewing direction."""
    code_pi: bool = later(True)
    """Whether the bands are sin and cos of 2^k pi u, as in NeRF's equation 4, else of 2^k u."""
    code_identity: bool = later(True)
    """Whether u itself stands before its bands; NeRF's equation 4 has the bands alone."""
    head_hidden: int = 128
    """Width of the two hidden layers of each head."""
    position_nodes: int = 1024
    """Nodes K on [-1, 1] at which the position heads are tabulated. K is part of the model: the nodes do not resolve
    the highest band, so a field trained at one K is another field at another K."""
    view_nodes: int = 32
    """Nodes on each side of the octahedral map at which the direction head is tabulated. Part of the model too."""
    core: Literal["free", "network"] = later("free")
    """What the channel core G_c is. free: numbers of its own. network: a head like the others over the channel's place
    among the C, evenly spaced on [-1, 1] (definition 5 of the paper)."""
    core_scale: float = 0.1
    """Standard deviation of a free channel core at the start."""

    def __post_init__(self) -> None:
        for name, most in LARGEST.items():
            if getattr(self, name) > most:
                raise RecipeError(f"light.ring.{name} is {getattr(self, name)}; give at most {most}")
        for name in ("rank", "features", "head_hidden"):
            if getattr(self, name) < 1:
                raise RecipeError(f"light.ring.{name} is {getattr(self, name)}; give at least 1")
        if not 0 <= self.core_scale < math.inf:
            raise RecipeError(f"light.ring.core_scale is {self.core_scale:g}; give 0 or more, but finite")
        self._refuse_codes()
        self._refuse_tables()

    def _refuse_codes(self) -> None:
        for name in ("bands", "view_bands"):
            if getattr(self, name) < 0:
                raise RecipeError(f"light.ring.{name} is {getattr(self, name)}; give 0 (no Fourier features) or more")
        if not self.code_identity and min(self.bands, self.view_bands) < 1:
            raise RecipeError("light.ring.code_identity is off and there are no bands; the heads would see nothing")

    def _refuse_tables(self) -> None:
        for name in ("position_nodes", "view_nodes"):
            if getattr(self, name) < 2:
                raise RecipeError(f"light.ring.{name} is {getattr(self, name)}; interpolation needs at least 2 nodes")
        if (3 * self.position_nodes + self.view_nodes**2) * self.rank**2 > LARGEST_TABLES:
            raise RecipeError("light.ring asks for tables of over a gigabyte; give a lower rank or fewer nodes")


@dataclass(frozen=True)
class KnotSettings:
    """The ring with discrete cores: matrices at knots in place of networks (the paper's "w/o neural module")."""

    axis: int = 64
    """Knots of each coordinate on [-1, 1], linear in between."""
    view: int = 16
    """Knots on each side of the octahedral map of directions."""

    def __post_init__(self) -> None:
        check_counts("light.knots", axis=(self.axis, 2, 65_536), view=(self.view, 2, 512))


@dataclass(frozen=True)
class VectorMatrixSettings:
    """The vector-matrix field (TensoRF, 3iGS): planes times lines, times a map of directions."""

    side: int = 64
    """Nodes on each side of a plane and along a line. TensoRF and 3iGS take 128 to 300, which are megabytes."""
    components: int = 16
    """Products of plane and line for each of the three ways to pair them."""
    view: int = 16
    """Nodes on each side of the octahedral map of directions."""

    def __post_init__(self) -> None:
        counts = {"side": (self.side, 2, 2048), "components": (self.components, 1, 512), "view": (self.view, 2, 512)}
        check_counts("light.vm", **counts)


@dataclass(frozen=True)
class PerceptronSettings:
    """One network over encoded position and direction (the paper's "w/o TR")."""

    hidden: int = 128
    """Width of the hidden layers. 0 takes the width at which the network holds as many numbers as the ring."""
    layers: int = 2
    """Hidden layers."""

    def __post_init__(self) -> None:
        check_counts("light.mlp", hidden=(self.hidden, 0, 4096), layers=(self.layers, 1, 16))


def check_counts(where: str, **counts: tuple[int, int, int]) -> None:
    """Raises RecipeError for a count (given, least, most) out of its range."""
    for name, (count, least, most) in counts.items():
        if not least <= count <= most:
            raise RecipeError(f"{where}.{name} is {count}; give {least} to {most}")
