"""Cubemaps blurred by the lobes of rough mirrors, as one fixed linear map of the texels.

The first half of the split-sum approximation (Karis, Real Shading in Unreal Engine 4, 2013): a surface of roughness r
with normal n that is looked at from straight above reflects light from l with the weight

    w(l) = D(n.h) (n.l),    h = (n + l) / |n + l|,    D(c) = a^2 / (pi (c^2 (a^2 - 1) + 1)^2),    a = r^2,

D being the GGX distribution of Walter et al. (2007), and its light is the mean of the environment by w. The mean is a
sum over texels. Far from the lobe's axis, where w is smooth, it takes texels of smaller mips, as the algorithm of
Barnes and Hut does for forces. Texels, roughnesses and lobes never change, so that the sums are a sparse matrix that is
made once; the way back is its transpose.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy.sparse import csr_array
from scipy.spatial import cKDTree
from torch import Tensor

from ringlight import _kernels
from ringlight.fields.cubemap import FACES, border
from ringlight.fields.texel_directions import children, solid_angles, texel_directions

LOBE_SHARE = 0.9
"""Share of the microfacets' area within the lobe's cut: GGX has tails as far as one looks, of which texels that are
hardly seen would be most of the map."""

REFINED_WITHIN = 1.75
"""A texel is taken in four parts where it is nearer to the lobe's axis than so many of its own widths."""

QUAD = 4
"""Floats that the kernels take of each row; colours fill three."""

Weights = Float[np.ndarray, "..."]
Numbers = Int[np.ndarray, "E"]


@dataclass(frozen=True)
class Level:
    """A blurred cubemap of this ``side``: by the lobe of ``roughness``, or by the cosine where that is None."""

    side: int
    roughness: float | None


def lobe(cosines: Weights, roughness: float | None) -> Weights:
    """What light at these cosines to the normal counts per steradian, up to a factor; none from below."""
    above = np.maximum(cosines, 0)
    if roughness is None:
        return above
    a2 = roughness**4
    halfway = (1 + cosines) / 2  # squared cosine of the half angle
    return above * a2 / (math.pi * (halfway * (a2 - 1) + 1) ** 2)


def cut_angle(roughness: float | None) -> float:
    """Angle from the normal, radians, from which on light is left out: of D(n.h) (n.h) over the half vectors h,
    ``LOBE_SHARE`` lies within tan^2 = a^2 s / (1 - s)."""
    if roughness is None:
        return math.pi / 2
    return min(2 * math.atan(roughness**2 * math.sqrt(LOBE_SHARE / (1 - LOBE_SHARE))), math.pi / 2)


def mip_sides(finest: int, coarsest: int) -> tuple[int, ...]:
    """Each half of the one before it."""
    return tuple(finest >> halved for halved in range((finest // coarsest).bit_length()))


@dataclass(frozen=True)
class SparseMap:
    """``rows`` sums of ``weights`` times entries of a vector of ``width``, of which ``sources`` gives the numbers, one
    sum after another; ``starts`` says where each begins, and where the last one ends. ``kernel`` is the same.
    """

    rows: int
    width: int
    starts: Int[Tensor, "R1"]
    sources: Int[Tensor, "E"]
    weights: Float[Tensor, "E"]
    kernel: _kernels.SparseMatrix

    def times(self, values: Float[Tensor, "T C"]) -> Float[Tensor, "R C"]:
        """The sums, in an order that is the same for any number of threads; by the kernel for up to four columns of
        float32 on the CPU."""
        missing = QUAD - values.shape[1]
        if values.dtype != torch.float32 or not values.is_cpu or missing < 0:
            return self.reference(values)
        return self.of_quads(torch.nn.functional.pad(values, (0, missing)))[:, : values.shape[1]]

    def of_quads(self, values: Float[Tensor, "T 4"]) -> Float[Tensor, "R 4"]:
        """The kernel's sums, without a copy; float32 on the CPU."""
        sums = values.new_empty(self.rows, QUAD)
        _kernels.sparse_product(self.kernel, values.detach().contiguous(), sums)
        return sums

    def reference(self, values: Float[Tensor, "T C"]) -> Float[Tensor, "R C"]:
        """The same in torch, in any precision."""
        starts, sources = self.starts.to(values.device), self.sources.to(values.device)
        return torch.nn.functional.embedding_bag(
            sources,
            values,
            starts,
            mode="sum",
            per_sample_weights=self.weights.to(values),
            include_last_offset=True,
        )


def _torch_map(matrix: csr_array) -> SparseMap:
    matrix = csr_array(matrix)
    matrix.sort_indices()
    starts, sources = (torch.from_numpy(numbers.astype(np.int32)) for numbers in (matrix.indptr, matrix.indices))
    weights = torch.from_numpy(matrix.data.astype(np.float32))
    rows, width = matrix.shape
    return SparseMap(rows, width, starts, sources, weights, _kernels.SparseMatrix(starts, sources, weights, width))


@lru_cache(maxsize=4)
def prefilter(mips: tuple[int, ...], levels: tuple[Level, ...]) -> tuple[SparseMap, SparseMap]:
    """From the mips' texels, one mip after another, to the ``levels``, bordered, see ``fields/cubemap.py``, one after
    another; and the transpose of that map. No level has a side that no mip has."""
    blocks = [_bordered(_blur(level, mips), level.side) for level in levels]
    whole = _stacked(blocks)
    return _torch_map(whole), _torch_map(csr_array(whole.T))


def _stacked(blocks: list[csr_array]) -> csr_array:
    from scipy.sparse import vstack

    return csr_array(vstack(blocks))


def _blur(level: Level, mips: tuple[int, ...]) -> csr_array:
    """Rows: the texels of the level. Columns: those of all mips. Each row adds up to one."""
    offsets = dict(zip(mips, np.cumsum([0, *(FACES * side * side for side in mips[:-1])]), strict=True))
    axes, cut = texel_directions(level.side).numpy(), cut_angle(level.roughness)
    coarsest, rows, columns, weights = mips[-1], [], [], []
    row, texel = _within(axes, coarsest, cut + _width(coarsest))
    for side in (side for side in reversed(mips) if side <= max(level.side, coarsest)):
        cosines = (axes[row] * texel_directions(side).numpy()[texel]).sum(-1)
        angles = np.arccos(np.clip(cosines, -1, 1))
        inside = angles < cut + _width(side) / (2 if side == level.side else 1)
        split = inside & (angles < REFINED_WITHIN * _width(side)) & (side < level.side)
        kept = inside & ~split
        rows.append(row[kept])
        columns.append(texel[kept] + offsets[side])
        weights.append(lobe(cosines[kept], level.roughness) * solid_angles(side).numpy()[texel[kept]])
        row, texel = np.repeat(row[split], 4), children(side).numpy()[texel[split]].reshape(-1)
    whole = np.concatenate(weights)
    seen = whole > 0
    count = offsets[coarsest] + FACES * coarsest * coarsest
    places = (np.concatenate(rows)[seen], np.concatenate(columns)[seen])
    found = csr_array((whole[seen], places), shape=(len(axes), count))
    return csr_array(found.multiply(1 / found.sum(1)[:, None]))


def _width(side: int) -> float:
    """Of a texel at the middle of a face, radians."""
    return 2 / side


def _within(axes: Weights, side: int, angle: float) -> tuple[Numbers, Numbers]:
    """All pairs of an axis and a texel that are no further apart than ``angle``, radians."""
    chord = 2 * math.sin(min(angle, math.pi) / 2)
    near = cKDTree(texel_directions(side).numpy()).query_ball_point(axes, chord, return_sorted=True)
    counts = np.array([len(found) for found in near])
    return np.repeat(np.arange(len(axes)), counts), np.concatenate([np.asarray(found) for found in near])


def _bordered(blur: csr_array, side: int) -> csr_array:
    """With the rows of :func:`bordered` in place of the level's own texels."""
    wide = side + 2
    places, sources = (table.numpy() for table in border(side))
    own = np.arange(FACES * side * side)
    face, texel = np.divmod(own, side * side)
    inner = (face * wide + texel // side + 1) * wide + texel % side + 1
    rows = np.concatenate([inner, np.repeat(places, sources.shape[1])])
    columns = np.concatenate([own, sources.reshape(-1)])
    shares = np.concatenate([np.ones(len(own)), np.full(sources.size, 1 / sources.shape[1])])
    return csr_array(csr_array((shares, (rows, columns)), shape=(FACES * wide * wide, len(own))) @ blur)
