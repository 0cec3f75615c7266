"""Ranks and bytes of putt's two trains, of density and of appearance."""

import math
from dataclasses import dataclass

from ringlight.core.kernel_limits import VOLUME_CELLS_A_BYTE, VOLUME_FREQUENCIES, VOLUME_MOST_CELLS
from ringlight.core.words import MEGABYTE
from ringlight.volume.tt_ranks import OCTANTS, numbers_of

PAPER_RANKS = (200, 280)
"""Of density and appearance."""

PAPER_SIZES = (7, 12)
"""Megabytes of the paper's models."""

FEWEST_RANKS, MOST_RANKS = 2, 1024
"""Beyond these a number is a mistake."""

RANK_STEP = 8
"""Ranks that follow from a size are multiples: torch takes twice as long for matrices 251 wide as for those of 248."""

FLOAT_BYTES = 4

COPIES, SCALED_COPIES = 6, 5
"""Of the trains while they are trained: values, gradients, those of a regularizer, two moments, and the mean of models;
and where steps are scaled, scaled gradients, directions, steps in two bases, and the maps that scale them and what
means are multiplied by, up to two thirds of one each."""


@dataclass(frozen=True)
class TrainSizes:
    """Of a finished model whose network has so many inputs and units. The grid has 2 to the power of ``levels`` nodes
    along each axis, and twice as many along ``long`` ones."""

    features: int
    hidden: int
    levels: int
    long: int = 0

    def bytes_of(self, ranks: tuple[int, int]) -> int:
        """With bits for all cells."""
        inputs = (1 + 2 * VOLUME_FREQUENCIES) * (self.features + 3)
        network = (inputs + self.hidden + 2) * self.hidden + 3 * (self.hidden + 1)
        trains = numbers_of_both(self.features, self.levels, ranks, self.long)
        longest = 1 << (self.levels + (self.long > 0))
        return FLOAT_BYTES * (network + trains) + min(longest, VOLUME_MOST_CELLS) ** 3 // VOLUME_CELLS_A_BYTE

    def numbers_in_training(self, ranks: tuple[int, int], scaled: bool) -> int:
        """Roughly how many a training keeps, with steps that are ``scaled`` or not."""
        # Entries of all blocks and their gradients; matrices of blocks, theirs, and two copies in order, since threads
        # share them out.
        entries = 2 * 8**self.levels << self.long
        matrices = 4 * (8 ** (self.levels // 2) << self.long) * self.features * ranks[1]
        copies = COPIES + (SCALED_COPIES if scaled else 0)
        return copies * numbers_of_both(self.features, self.levels, ranks, self.long) + entries + matrices

    @property
    def range(self) -> tuple[float, float]:
        """Megabytes of the smallest and the largest, to hundredths that are within."""
        least, most = (self.bytes_of(in_proportion(rank)) / MEGABYTE for rank in (RANK_STEP, MOST_RANKS))
        return math.ceil(100 * least) / 100, math.floor(100 * most) / 100

    def ranks_within(self, megabytes: float) -> tuple[int, int]:
        """The largest whose model is as small; within :attr:`range`."""
        fits = RANK_STEP
        for rank in range(RANK_STEP, MOST_RANKS + 1, RANK_STEP):
            if self.bytes_of(in_proportion(rank)) > megabytes * MEGABYTE:
                break
            fits = rank
        return in_proportion(fits)


def in_proportion(appearance: int) -> tuple[int, int]:
    """Ranks in about the paper's proportion."""
    steps = round(appearance * PAPER_RANKS[0] / PAPER_RANKS[1] / RANK_STEP)
    return max(steps, 1) * RANK_STEP, appearance


def numbers_of_both(features: int, levels: int, ranks: tuple[int, int], long: int = 0) -> int:
    """Of both trains."""
    all_levels, first = (levels + 1, 1 << long) if long else (levels, OCTANTS)
    return numbers_of(1, all_levels, ranks[0], first) + numbers_of(features, all_levels, ranks[1], first)


def levels_of(side: int) -> int:
    """Of a grid of so many nodes along each axis, a power of two."""
    return side.bit_length() - 1
