"""At the end: rows share harmonics of a codebook where that costs least, and all numbers become what files hold.

LightGaussian (Fan et al. 2023), section 3.4, "VecTree quantization", shares those of the rows of least significance.
What a row loses is its significance times the distance to its code; to choose by that loses a quarter to a half as much
(docs/methods/light-gaussian.md).
"""

from collections.abc import Callable, Mapping, Sequence

import torch
from jaxtyping import Float, Int
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.gradients import COLUMNS
from ringlight.core.randomness import generator
from ringlight.core.rendering import Rendering
from ringlight.core.sh_basis import basis_count
from ringlight.fit.codebook import codebook
from ringlight.fit.optimizer import Optimizer
from ringlight.fit.strategies.global_significance import global_significance
from ringlight.fit.strategies.stateless import Stateless
from ringlight.models.splats import SplatModel

REST = "sh_rest"

ROWS_PER_CODE = 6
"""At least: a codebook of nearly as many codes as rows saves nothing, and takes its own bytes."""

FIRST_ROUNDS, ROUNDS = 5, 20
"""Of k-means: to choose rows, and of the codebook that these get. The error falls by less than a hundredth after 20."""


class QuantizeColors(Stateless):
    """After step ``last``. Of the ``share`` of rows that lose least, the harmonics without the constant one are those
    of up to ``codes`` codes; ``rounded`` gives what a file holds of columns, by their full names."""

    def __init__(
        self,
        last: int,
        share: float,
        codes: int,
        cameras: Sequence[Camera],
        volume_power: float,
        rounded: Callable[[Mapping[str, Tensor]], dict[str, Tensor]],
        seed: int,
    ):
        self.last, self.share, self.codes, self.rounded = last, share, codes, rounded
        self.cameras, self.volume_power, self.seed = cameras, volume_power, seed

    @torch.no_grad()
    def update(self, step: int, model: SplatModel, optimizer: Optimizer, prediction: Rendering) -> None:
        if step != self.last:
            return
        columns = {COLUMNS + name: column.detach().clone() for name, column in model.columns.items()}
        columns[COLUMNS + REST] = self._shared(model, step).to(model.device)
        for name, values in self.rounded(columns).items():
            model.get_parameter(name).copy_(values)  # in place: moments stay with their rows

    def _shared(self, model: SplatModel, step: int) -> Tensor:
        """The harmonics, with those of a codebook in the rows that lose least by it."""
        worth = global_significance(model, self.cameras, self.volume_power).cpu()
        rest = model.columns[REST].detach().cpu().clone()
        used = basis_count(int(model.get_buffer("color.active_degree"))) - 1
        count = int(self.share * len(rest))
        codes = min(self.codes, count // ROWS_PER_CODE)
        if codes and used:
            drawn, seen = generator(self.seed, step, "codebook"), rest[:, :used].flatten(1)
            rows = rows_that_lose_least(seen, worth, count, codes, drawn)
            book, numbers = codebook(seen[rows], worth[rows], codes, ROUNDS, drawn)
            rest[rows, :used] = book[numbers].reshape(count, used, -1)
        return rest


def rows_that_lose_least(
    seen: Float[Tensor, "N D"], worth: Float[Tensor, "N"], count: int, codes: int, drawn: torch.Generator
) -> Int[Tensor, "K"]:
    """The ``count`` rows, ascending, of least ``worth`` times squared distance to their codes, if all rows have some of
    so many ``codes``."""
    book, numbers = codebook(seen, worth, codes, FIRST_ROUNDS, drawn)
    lost = worth * (seen - book[numbers]).square().sum(1)
    return lost.argsort(stable=True)[:count].sort().values
