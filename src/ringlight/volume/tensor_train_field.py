"""Density and appearance as two quantised tensor trains (PuTT, Loeschcke et al. 2024, section 3)."""

import math

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ringlight.volume.contract import Sides
from ringlight.volume.halves import multiplies_halves
from ringlight.volume.prolongation import prolonged
from ringlight.volume.shading import FeatureShading
from ringlight.volume.tt_ranks import AXES, OCTANTS, modes_of, ranks_of
from ringlight.volume.tt_sampling import from_blocks, from_grid, from_points
from ringlight.volume.tt_scaling import Scaling, scalings

FIRST_DEVIATION = 0.1
"""Standard deviation of a grid's entries at the start."""

LEVELS_OF_GRID = 5
"""Up to as many entries as 32 cubed has all are contracted (docs/methods/putt.md, as are the others)."""

FEWEST_LEVELS = 2
"""One for blocks and one for nodes in them."""

LEVELS_OF_BLOCKS = 6
"""Of appearance: up to as many entries as 64 cubed has those of blocks are written down."""


class TensorTrain(nn.Module):
    """``cores.k`` [r 8 s]: one for each level that there may be; the first one has ``first`` octants, perhaps 4 or 2.
    Those of levels that are not reached yet are ones, of shape [1 8 1]: what a node has, all within it have."""

    def __init__(
        self, payload: int, levels: int, deepest: int, most: int, generator: torch.Generator, first: int = OCTANTS
    ):
        super().__init__()
        self.payload, self.most = payload, most
        ranks = ranks_of(payload, levels, most, first)
        self.cores = nn.ParameterList()
        for k, mode in enumerate(modes_of(levels, first)):
            core = torch.empty(ranks[k], mode, ranks[k + 1]).normal_(0, 1, generator=generator)
            # Sums over a left rank keep the entries' variance; the payload is no sum.
            self.cores.append(nn.Parameter(core * FIRST_DEVIATION ** (1 / levels) * (ranks[k] ** -0.5 if k else 1.0)))
        self.cores.extend([nn.Parameter(torch.ones(1, OCTANTS, 1)) for _ in range(levels, deepest)])

    @property
    def levels(self) -> int:
        """Of its resolution: 2 to this power nodes along the axes with the most."""
        return 1 + sum(core.shape[0] > 1 for core in list(self.cores)[1:])

    @property
    def reached(self) -> list[Tensor]:
        """The cores of its levels."""
        return list(self.cores)[: self.levels]

    @torch.no_grad()
    def deepen(self) -> None:
        """Take one more level."""
        finer, _ = prolonged(self.reached, self.most)
        for k, core in enumerate(finer):
            self.cores[k] = nn.Parameter(core)


class TensorTrainField(nn.Module):
    """A scalar train of density, and one of appearance that carries ``features`` in its first core.

    ``levels`` of ``deepest`` are reached. One or two ``long`` axes, of x, y and z as 0, 1 and 2, have twice the nodes
    of the others; the first core holds their first bits alone. To the trains they are the last axes of a cube, and all
    points lie in a half or a quarter of it.
    """

    long_axes: Tensor

    def __init__(
        self,
        levels: int,
        deepest: int,
        ranks: tuple[int, int],
        features: int,
        generator: torch.Generator,
        long: tuple[int, ...] = (),
    ):
        super().__init__()
        self._made = (deepest, ranks, features)
        if long:
            self.register_buffer("long_axes", torch.tensor(long, dtype=torch.uint8))
        first = 1 << len(long) if long else OCTANTS
        self.density_train = TensorTrain(1, levels, deepest, ranks[0], generator, first)
        self.appearance_train = TensorTrain(features, levels, deepest, ranks[1], generator, first)

    @property
    def long(self) -> tuple[int, ...]:
        """Axes with twice the nodes."""
        return tuple(self.long_axes.tolist()) if "long_axes" in self._buffers else ()

    @property
    def levels(self) -> int:
        """Of its resolution."""
        return self.density_train.levels

    @property
    def sides(self) -> Sides:
        """Nodes along x, y and z."""
        return self._sides_at(self.levels)

    @property
    def intervals(self) -> Sides:
        """As many as nodes: the last one lies one before the box's end, and stands for what is behind it."""
        return self.sides

    def density(self, points: Float[Tensor, "N 3"]) -> Float[Tensor, "N"]:
        """See :class:`ringlight.volume.contract.VolumeField`."""
        return sampled(self.density_train, self._in_cube(points))[:, 0]

    def appearance(self, points: Float[Tensor, "N 3"]) -> Float[Tensor, "N F"]:
        """See :class:`ringlight.volume.contract.VolumeField`."""
        return sampled(self.appearance_train, self._in_cube(points))

    def kernels(self, shading: FeatureShading) -> None:
        """None: what is fast about it, torch asks for (``tt_bags``, ``tt_blocks``)."""

    def scalings(self, share: float) -> dict[str, Scaling]:
        """For steps of its cores, by parameter name; ``share`` in [0, 1) as in :func:`scalings`."""
        found: dict[str, Scaling] = {}
        for name, train in (("density_train", self.density_train), ("appearance_train", self.appearance_train)):
            found |= {f"{name}.cores.{k}": scaling for k, scaling in enumerate(scalings(train.reached, share))}
        return found

    def outline(self, sides: Sides) -> dict[str, Tensor]:
        """See :class:`ringlight.volume.contract.VolumeField`."""
        deepest, ranks, features = self._made
        if list(self.long) != sorted({axis for axis in self.long if axis < AXES}):
            raise ValueError(f"tensor 'field.long_axes' is {list(self.long)}; axes are 0, 1 and 2, in order")
        levels = self._levels_of(sides)
        return dict(TensorTrainField(levels, deepest, ranks, features, torch.Generator(), self.long).named_parameters())

    def fitting(self, box: Float[Tensor, "2 3"], voxels: float | int) -> Sides:
        """A power of two along each axis, twice as many along long ones, whatever the box."""
        deepest, _, _ = self._made
        more = bool(self.long)
        levels = more + max(round((math.log2(voxels) - len(self.long)) / AXES), FEWEST_LEVELS)
        return self._sides_at(min(levels, deepest))

    def cuttable(self, first: Sides, last: Sides) -> tuple[Sides, Sides]:
        """All of it."""
        x, y, z = self.sides
        return (0, 0, 0), (x - 1, y - 1, z - 1)

    def resize(self, sides: Sides) -> None:
        """See :class:`ringlight.volume.contract.VolumeField`."""
        for _ in range(self.levels, self._levels_of(sides)):
            self.density_train.deepen()
            self.appearance_train.deepen()

    def crop(self, first: Sides, last: Sides) -> None:
        """Nothing: see :meth:`cuttable`."""

    def _in_cube(self, points: Float[Tensor, "N 3"]) -> Float[Tensor, "N 3"]:
        """As the trains see them."""
        long = self.long
        if not long:
            return points
        # Behind the last node there is its value; in the cube there would be another.
        last = 0.5 - 1 / (1 << self.levels)
        lower = [(points[:, axis] * 0.5).clamp_max(last) for axis in range(AXES) if axis not in long]
        return torch.stack([*lower, *(points[:, axis].clamp_max(1) for axis in long)], 1)

    def _sides_at(self, levels: int) -> Sides:
        long = self.long
        x, y, z = (1 << (levels - (bool(long) and axis not in long)) for axis in range(AXES))
        return x, y, z

    def _levels_of(self, sides: Sides) -> int:
        """Raises ValueError for sides that these trains do not have."""
        levels = max(max(sides) - 1, 1).bit_length()
        if sides != self._sides_at(levels):
            twice = f", twice as many along {' and '.join('xyz'[axis] for axis in self.long)}" if self.long else ""
            raise ValueError(f"a tensor train has a power of two of nodes along each axis{twice}, not {sides}")
        return levels


def sampled(train: TensorTrain, points: Float[Tensor, "N 3"]) -> Float[Tensor, "N C"]:
    """By the way that is faster on a CPU."""
    if not len(points):
        return points.new_zeros(0, train.payload)
    cores = train.reached
    if points.is_cpu and points.dtype == torch.float32 and multiplies_halves():
        cores = [core.bfloat16() for core in cores]
    entries = math.prod(core.shape[1] for core in cores)
    if entries <= OCTANTS**LEVELS_OF_GRID:
        return from_grid(cores, points)
    few = int(cores[0].shape[1] < OCTANTS)  # such a first core is one more beside those of the levels
    levels = len(cores) - few
    # Blocks of one number an entry may be smaller: their matrices cost next to nothing.
    if train.payload == 1:
        return from_blocks(cores, points, few + (levels + 1) // 2)
    way = from_blocks if entries <= OCTANTS**LEVELS_OF_BLOCKS else from_points
    return way(cores, points, few + levels // 2)
