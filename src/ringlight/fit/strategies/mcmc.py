"""Density control as Markov chain Monte Carlo: the dead move to where Gaussians are wanted, and all may wander.

Kheradmand, Rebain, Sharma, Sun, Tseng, Isack, Kar, Tagliasacchi, Yi: 3D Gaussian Splatting as Markov Chain Monte Carlo,
NeurIPS 2024. Written from the paper.
"""

import math
from collections.abc import Sequence

import torch
from jaxtyping import Float, Int
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import COLUMNS
from ringlight.core.randomness import generator
from ringlight.core.rendering import Rendering
from ringlight.fit.optimizer import Optimizer
from ringlight.fit.strategies.copies import as_copies, drawn_rows, moved_apart
from ringlight.fit.strategies.densify_settings import DensifySettings
from ringlight.fit.strategies.mcmc_settings import GROWN_BY, PAPER_EXTENT
from ringlight.fit.strategies.morton import morton_order
from ringlight.fit.strategies.removal_effects import removal_effects
from ringlight.fit.strategies.stateless import Stateless
from ringlight.fit.strategies.wander import wander_
from ringlight.models.splats import SplatModel


class MCMC(Stateless):
    """Moves, adds and shakes rows; what was counted is the table itself, so that nothing is kept between steps.

    In each round rows that are dead, faint or not ``wanted`` by the colour model, become copies of others that are
    drawn in proportion to their opacity, and some are added likewise; copies of one row move apart. Rows leave in
    Morton order.
    In the first round rows go that hardly change the pictures of all ``cameras``: among random points these are most,
    and nothing else would clear their places within a short run.
    """

    def __init__(
        self,
        settings: DensifySettings,
        extent: float,
        cameras: Sequence[Camera],
        background: Float[Tensor, "3"],
        steps: int,
        seed: int,
    ):
        self.settings, self.cameras, self.background, self.seed = settings, cameras, background, seed
        self.first_step, self.last_step = settings.first_step(steps), settings.last_step(steps)
        self.most = self._budget = settings.most_growing(steps)
        # Noise goes with the square of lengths and the rate with a length; together they are to move by a length.
        self.noise = settings.mcmc.noise * (PAPER_EXTENT / extent) ** 2

    def update(self, step: int, model: SplatModel, optimizer: Optimizer, prediction: Rendering) -> None:
        if self.first_step < step <= self.last_step and step % self.settings.every == 0:
            self._edit(step, model, optimizer)
        if self.noise:
            with torch.no_grad():
                size = self.noise * optimizer.rate(COLUMNS + "means", step)
                draw = generator(self.seed, step, "wander")
                wander_(model.gaussians, size, self.settings.mcmc.dead, draw)

    def resets(self, step: int) -> bool:
        """Opacities are never lowered."""
        return False

    def _edit(self, step: int, model: SplatModel, optimizer: Optimizer) -> None:
        whole = Gaussians.from_columns({name: column.detach() for name, column in model.columns.items()})
        kept = torch.arange(len(whole), device=whole.means.device)
        is_first = step // self.settings.every == self._first_round
        most = max(int(self.settings.mcmc.first_share * self._budget), 1) if is_first else self._budget
        if len(whole) > most:
            kept = self._needed(step, most, model)
        table = whole.rows(kept)
        alive = (table.opacities > self.settings.mcmc.dead) & model.color.wanted(table)
        if not bool(alive.any()):
            alive = torch.ones_like(alive)  # there is nowhere to move to
        missing = int((~alive).sum()) + self._grown(step, len(table)) - len(table)
        if not missing and len(kept) == len(whole):
            return
        sources = drawn_rows(table.opacities * alive, missing, generator(self.seed, step, "copies"))
        copies = 1 + torch.bincount(sources, minlength=len(table))
        split = (copies > 1).nonzero()[:, 0]
        # Those in place are new rows too: their moments belong to the Gaussian that they were.
        copied = torch.cat([split, sources])
        added = as_copies(table.rows(copied), copies[copied], self.settings.mcmc.dead, model.color.opacity_columns)
        if self.settings.mcmc.apart:
            added = moved_apart(added, self.settings.mcmc.apart, generator(self.seed, step, "apart"))
        left = kept[alive & (copies == 1)]
        rows = torch.cat([left, len(whole) + torch.arange(len(added), device=left.device)])
        optimizer.edit_rows(rows[morton_order(torch.cat([whole.means, added.means])[rows])], added)

    @property
    def _first_round(self) -> int:
        """Its number; rounds are numbered from the first step on."""
        return self.first_step // self.settings.every + 1

    def _needed(self, step: int, count: int, model: SplatModel) -> Int[Tensor, "K"]:
        """The ``count`` rows, in their order, whose removal would change the pictures most."""
        effects = removal_effects(model, self.cameras, self.background, self.seed, step)
        return effects.argsort(descending=True, stable=True)[:count].sort().values

    def _grown(self, step: int, count: int) -> int:
        """How many rows this round ends with, of ``count``: the budget where it is the last in which rows are added."""
        every = self.settings.every
        first, last = self._first_round, self.last_step // every
        full = first + int(GROWN_BY * (last - first))
        share = (self._budget / count) ** (1 / max(full + 1 - step // every, 1)) - 1
        # Rounds up, so that a few rows grow too.
        return max(min(math.ceil(count * (1 + max(self.settings.mcmc.growth, share))), self._budget), count)
