"""Rays are drawn where pictures are wrong: by blocks of pixels, in proportion to the last errors of their rays.

What a ray adds to a gradient grows with its error, and a mean over a lot has the least noise where rays are drawn in
proportion to what they add (Zhao, Zhang 2015; Katharopoulos, Fleuret 2018). Rays are weighted by how much more often an
even draw would take them, so that the mean stays.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

BLOCK = 4
"""Pixels along a block's sides. In 100 photographs of 400 x 400 a subject has some 300,000 blocks, and each is met
every hundred steps or so."""

PIXELS = BLOCK * BLOCK

NEW_SHARE = 0.2
"""Of a block's error that one more ray of it decides."""

UNSEEN = 1.0
"""Stands for the error of a block before its first ray; it is drawn as if it had the mean of the others."""

KEPT_AT_ONCE = 1 << 20
"""Rays whose blocks are told together: some 90 MB."""


@dataclass(frozen=True)
class DrawnRays:
    """Numbers of rays, their weights in the mean, and the blocks that they lie in."""

    index: Int[Tensor, "R"]
    weights: Float[Tensor, "R"]
    blocks: Int[Tensor, "R"]


class RayErrors:
    """Of photographs of these ``widths`` and ``heights``, whose pixels follow each other row by row.

    A ``share`` of the rays, from 0 to below 1, is drawn by error and the others evenly, so that no weight is above
    1 / (1 - share). ``errors`` [B], in [0, 1], are all that is remembered of earlier rays.
    """

    def __init__(self, widths: Int[Tensor, "V"], heights: Int[Tensor, "V"], share: float):
        self.share = share
        self._widths, self._across = widths, _blocks_along(widths)
        blocks = self._across * _blocks_along(heights)
        self._first_blocks, self._first_rays = _starts(blocks), _starts(widths * heights)
        self.errors = torch.full((int(blocks.sum()),), UNSEEN)
        self._all_rays = int((widths * heights).sum())
        self._met = self._bits = self._counts = torch.zeros(0, dtype=torch.int32)

    def keep(self, chosen: Bool[Tensor, "P"]) -> None:
        """From now on draw from the ``chosen`` ones of all rays alone; at least one."""
        bits, counts = (torch.zeros(len(self.errors), dtype=torch.int32) for _ in range(2))
        for begin, part in zip(range(0, len(chosen), KEPT_AT_ONCE), chosen.split(KEPT_AT_ONCE), strict=True):
            blocks, pixels = self._places_of(part.nonzero()[:, 0] + begin)
            bits.index_add_(0, blocks, 1 << pixels)
            counts.index_add_(0, blocks, torch.ones_like(pixels))
        self._met = counts.nonzero()[:, 0]
        self._bits, self._counts = bits[self._met], counts[self._met]

    @property
    def kept_rays(self) -> int:
        """Those that are drawn from."""
        return int(self._counts.sum()) if len(self._counts) else self._all_rays

    @property
    def bytes_kept(self) -> int:
        """Of which rays blocks have; errors are counted by who keeps them for a resumed run."""
        return sum(each.numel() * each.element_size() for each in (self._met, self._bits, self._counts))

    def draw(self, count: int, generator: torch.Generator) -> DrawnRays:
        """``count`` rays, with replacement."""
        if not len(self._counts):
            self.keep(torch.ones(self._all_rays, dtype=torch.bool))
        even = self._counts / self._counts.sum(dtype=torch.float64)
        wrong = self._roots().mul_(self._counts)
        total = wrong.cumsum(0)[-1]  # a sum would be rounded otherwise by other numbers of threads
        chance = torch.lerp(even, wrong / total, self.share) if total > 0 else even
        ends = chance.cumsum(0)
        drawn = torch.rand(2, count, generator=generator, dtype=torch.float64)
        place = torch.searchsorted(ends, drawn[0] * ends[-1], right=True).clamp_max(len(ends) - 1)
        blocks, before = self._met[place], (drawn[1] * self._counts[place]).int()
        kept = (self._bits[place, None] >> torch.arange(PIXELS, dtype=torch.int32)) & 1
        pixels = (kept.cumsum(1) <= before[:, None]).sum(1)
        return DrawnRays(self._rays_at(blocks, pixels), (even[place] / chance[place]).float(), blocks)

    def _roots(self) -> Float[Tensor, "M"]:
        """Of the errors of blocks that are drawn from."""
        errors = self.errors[self._met].double()
        seen = errors < UNSEEN
        rays = (self._counts * seen).cumsum(0)[-1]
        if rays > 0:
            errors[~seen] = (errors * seen * self._counts).cumsum(0)[-1] / rays
        return errors.sqrt_()

    def learn(self, blocks: Int[Tensor, "R"], errors: Float[Tensor, "R"]) -> None:
        """What rays of these blocks had, mean squares in [0, 1], a lot at once. What is not finite is left out."""
        known = errors.isfinite()
        seen, place, rays = torch.unique(blocks[known], return_inverse=True, return_counts=True)
        mean = torch.zeros(len(seen)).index_add_(0, place, errors[known].clamp(0, UNSEEN)) / rays
        before = self.errors[seen]
        self.errors[seen] = torch.where(before < UNSEEN, torch.lerp(mean, before, (1 - NEW_SHARE) ** rays), mean)

    def _places_of(self, rays: Int[Tensor, "N"]) -> tuple[Int[Tensor, "N"], Int[Tensor, "N"]]:
        """Their blocks, and pixels in these."""
        view = torch.searchsorted(self._first_rays, rays, right=True) - 1
        pixel, width = rays - self._first_rays[view], self._widths[view]
        row = torch.div(pixel, width, rounding_mode="floor")
        column = pixel - row * width
        block = self._first_blocks[view] + (row // BLOCK) * self._across[view] + column // BLOCK
        return block, ((row % BLOCK) * BLOCK + column % BLOCK).int()

    def _rays_at(self, blocks: Int[Tensor, "N"], pixels: Int[Tensor, "N"]) -> Int[Tensor, "N"]:
        """The inverse."""
        view = torch.searchsorted(self._first_blocks, blocks, right=True) - 1
        block, across = blocks - self._first_blocks[view], self._across[view]
        row = torch.div(block, across, rounding_mode="floor")
        column = (block - row * across) * BLOCK + pixels % BLOCK
        return self._first_rays[view] + (row * BLOCK + pixels // BLOCK) * self._widths[view] + column


def _blocks_along(pixels: Int[Tensor, "V"]) -> Int[Tensor, "V"]:
    """Blocks that cover so many."""
    return torch.div(pixels + BLOCK - 1, BLOCK, rounding_mode="floor")


def _starts(counts: Int[Tensor, "V"]) -> Int[Tensor, "V"]:
    """Where each of so many begins."""
    return counts.cumsum(0) - counts
