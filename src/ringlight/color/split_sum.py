"""A distant environment as rough surfaces see it: a cubemap, and blurred copies of it by roughness."""

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from ringlight.core.kernel_limits import ENVIRONMENT_MAX_SIDE
from ringlight.errors import RecipeError
from ringlight.fields.cubemap import FACES, cubemap_places
from ringlight.fields.prefilter import Level, SparseMap, mip_sides, prefilter

SMOOTHEST, ROUGHEST_OF_CHAIN = 0.08, 0.5
"""Roughness of the finest and of the coarsest map of the chain, as in GaussianShader; between them it rises evenly."""

COARSEST = 16
"""Side of the coarsest map of the chain."""

ROUGH_SIDE = 8
"""Side of the maps for roughness 1 and for diffuse light: their lobes are wider than four of its texels."""

FIRST_LIGHT = 0.8
"""Brightness of the environment at the start, as in GaussianShader: a cloudy sky."""


Place = tuple[Int[Tensor, "N"], Float[Tensor, "N"], Float[Tensor, "N"]]
"""See :func:`ringlight.fields.cubemap.cubemap_places`."""


class _Filtered(torch.autograd.Function):
    """A sparse map of texels, whose way back is its transpose."""

    @staticmethod
    def forward(ctx, values: Tensor, there: SparseMap, back: SparseMap) -> Tensor:  # type: ignore[no-untyped-def]
        ctx.back = back
        return there.times(values)

    @staticmethod
    def backward(ctx, gradient: Tensor) -> tuple[Tensor, None, None]:  # type: ignore[no-untyped-def]
        return ctx.back.times(gradient.contiguous()), None, None


class _Tapped(torch.autograd.Function):
    """Sums over the first axis of a table's ``rows`` times ``weights``; the way back adds up in the order of the terms.

    Column by column: torch adds up over a last axis of three tens of times slower than over many numbers at once.
    """

    @staticmethod
    def forward(ctx, table: Tensor, rows: Tensor, weights: Tensor) -> Tensor:  # type: ignore[no-untyped-def]
        taken = [column.index_select(0, rows.flatten()).view(rows.shape) for column in table.T.contiguous()]
        ctx.save_for_backward(rows, weights, *taken)
        ctx.height = len(table)
        return torch.stack([(values * weights).sum(0) for values in taken], -1)

    @staticmethod
    def backward(ctx, gradient: Tensor) -> tuple[Tensor, None, Tensor]:  # type: ignore[no-untyped-def]
        rows, weights, *taken = ctx.saved_tensors
        columns = [column.contiguous() for column in gradient.unbind(-1)]
        of_weights = torch.zeros_like(weights)
        for values, column in zip(taken, columns, strict=True):
            of_weights.addcmul_(values, column)
        flat = rows.flatten()
        shares = [torch.bincount(flat, (weights * column).flatten(), minlength=ctx.height) for column in columns]
        return torch.stack(shares, -1).to(weights), None, of_weights


class SplitSumLight(nn.Module):
    """Parameter: ``texels`` [6 S S 3], logits of the environment's colours, see ``fields/cubemap.py``.

    S is 16 times a power of two. Raises RecipeError for another side.
    """

    def __init__(self, side: int, coarsest: int = COARSEST):
        super().__init__()
        doubled = side // coarsest
        if not coarsest <= side <= ENVIRONMENT_MAX_SIDE or doubled * coarsest != side or doubled.bit_count() != 1:
            raise RecipeError(
                f"a face of the environment has {side} texels on a side; "
                f"give {coarsest} times a power of two, up to {ENVIRONMENT_MAX_SIDE}"
            )
        self.texels = nn.Parameter(torch.full((FACES, side, side, 3), FIRST_LIGHT).logit())
        chain = mip_sides(side, coarsest)
        rise = (ROUGHEST_OF_CHAIN - SMOOTHEST) / max(len(chain) - 1, 1)
        rough_side = min(ROUGH_SIDE, coarsest)
        self._levels = (
            *(Level(own, SMOOTHEST + rise * number) for number, own in enumerate(chain)),
            Level(rough_side, 1.0),
            Level(rough_side, None),
        )
        self._mips = mip_sides(side, rough_side)

    @property
    def roughness(self) -> list[float]:
        """Of the blurred maps, rising."""
        return [level.roughness for level in self._levels if level.roughness is not None]

    @property
    def levels(self) -> tuple[Level, ...]:
        """The blurred maps, in their order."""
        return self._levels

    @property
    def sides(self) -> list[int]:
        """Of the same maps, and of that for diffuse light."""
        return [level.side for level in self._levels]

    def filters(self) -> tuple[SparseMap, SparseMap]:
        """From the :meth:`mips` to the maps, and the transpose."""
        return prefilter(self._mips, self._levels)

    def maps(self) -> Float[Tensor, "R 3"]:
        """The texels of all blurred maps, bordered, one after another; the last is that of diffuse light."""
        return self.maps_of(self.texels)

    def maps_of(self, texels: Float[Tensor, "6 S S 3"]) -> Float[Tensor, "R 3"]:
        """The same of other texels than the own."""
        filtered: Tensor = _Filtered.apply(self.mips(texels.sigmoid()), *self.filters())
        return filtered

    def mips(self, colors: Float[Tensor, "6 S S C"]) -> Float[Tensor, "T C"]:
        """These texels, and the means of four of them, and so on, one size after another."""
        mips = [colors.permute(0, 3, 1, 2)]
        for _ in self._mips[1:]:
            mips.append(torch.nn.functional.avg_pool2d(mips[-1], 2))
        return torch.cat([mip.permute(0, 2, 3, 1).reshape(-1, colors.shape[-1]) for mip in mips])

    def mips_gradient(self, of_mips: Float[Tensor, "T C"]) -> Float[Tensor, "6 S S C"]:
        """The way back of :meth:`mips`."""
        parts = of_mips.split([FACES * side * side for side in self._mips])
        total = of_mips.new_zeros(FACES, 1, 1, 1)
        for part, side in zip(reversed(parts), reversed(self._mips), strict=True):
            spread = total.repeat_interleave(2, 1).repeat_interleave(2, 2) / 4 if side != self._mips[-1] else total
            total = part.view(FACES, side, side, -1) + spread
        return total

    def specular(
        self, maps: Float[Tensor, "R 3"], directions: Float[Tensor, "N 3"], roughness: Float[Tensor, "N"]
    ) -> Float[Tensor, "N 3"]:
        """What a mirror of this roughness in [0, 1] shows in these directions; linear between two maps."""
        steps = torch.tensor(self.roughness, dtype=roughness.dtype, device=roughness.device)
        upper = torch.bucketize(roughness.detach(), steps).clamp(1, len(steps) - 1)
        lower = upper - 1
        share = ((roughness - steps[lower]) / (steps[upper] - steps[lower])).clamp(0, 1)
        place = cubemap_places(directions, 1)
        finer, of_finer = self._taps(place, lower)
        coarser, of_coarser = self._taps(place, upper)
        weights = torch.cat([of_finer * (1 - share), of_coarser * share])
        seen: Tensor = _Tapped.apply(maps, torch.cat([finer, coarser]), weights)
        return seen

    def diffuse(self, maps: Float[Tensor, "R 3"], normals: Float[Tensor, "N 3"]) -> Float[Tensor, "N 3"]:
        """The mean of the environment by the cosine to these normals."""
        last = torch.full((len(normals),), len(self._levels) - 1, device=normals.device)
        seen: Tensor = _Tapped.apply(maps, *self._taps(cubemap_places(normals, 1), last))
        return seen

    def _taps(self, place: Place, levels: Int[Tensor, "N"]) -> tuple[Int[Tensor, "4 N"], Float[Tensor, "4 N"]]:
        """Rows of :meth:`maps` around each place, on a cubemap of one texel a face, on its level, and their shares."""
        face, across, down = place
        every = torch.tensor([level.side for level in self._levels], device=face.device)
        area = FACES * (every + 2) ** 2
        side, first = every[levels], (torch.cumsum(area, 0) - area)[levels]
        wide, last = side + 2, side.to(across)
        # On one texel a face runs from 1/2 to 3/2, and on S from 1/2 to S + 1/2.
        across, down = (across - 0.5) * last + 0.5, (down - 0.5) * last + 0.5
        column, row = (torch.minimum(along.detach().floor().clamp_min(0), last) for along in (across, down))
        right, below = across - column, down - row
        first = first + (face * wide + row.long()) * wide + column.long()
        rows = torch.stack([first, first + 1, first + wide, first + wide + 1])
        left, above = 1 - right, 1 - below
        return rows, torch.stack([left * above, right * above, left * below, right * below])
