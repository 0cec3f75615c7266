"""At the end: rows of little significance share harmonics of a codebook, and all numbers become what files hold.

LightGaussian (Fan et al. 2023), section 3.4, "VecTree quantization".
"""

from collections.abc import Callable, Mapping, Sequence

import torch
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

ROUNDS = 20
"""Of k-means; the error falls by less than a hundredth after these."""


class QuantizeColors(Stateless):
    """After step ``last``. Of the ``share`` of rows with least significance the harmonics without the constant one are
    those of up to ``codes`` codes; ``rounded`` gives what a file holds of columns, by their full names."""

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
        """The harmonics with those of a codebook where little is seen of a row."""
        worth = global_significance(model, self.cameras, self.volume_power).cpu()
        rest = model.columns[REST].detach().cpu().clone()
        least = worth.argsort(stable=True)[: int(self.share * len(rest))]
        codes = min(self.codes, len(least) // ROWS_PER_CODE)
        used = basis_count(int(model.get_buffer("color.active_degree"))) - 1
        if codes and used:
            drawn, seen = generator(self.seed, step, "codebook"), rest[least, :used]
            book, numbers = codebook(seen.flatten(1), worth[least], codes, ROUNDS, drawn)
            rest[least, :used] = book[numbers].reshape(seen.shape)
        return rest
