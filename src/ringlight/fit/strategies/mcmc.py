"""Density control as Markov chain Monte Carlo: the dead move to where Gaussians are wanted, and all may wander.

Kheradmand, Rebain, Sharma, Sun, Tseng, Isack, Kar, Tagliasacchi, Yi: 3D Gaussian Splatting as Markov Chain Monte Carlo,
NeurIPS 2024. Written from the paper.
"""

import math
from collections.abc import Mapping, Sequence

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import COLUMNS
from ringlight.core.randomness import generator
from ringlight.core.rendering import Rendering
from ringlight.fit.optimizer import Optimizer
from ringlight.fit.strategies.copies import as_copies, as_parts, drawn_rows, moved_apart
from ringlight.fit.strategies.densify_settings import DensifySettings
from ringlight.fit.strategies.mcmc_settings import GROWN_BY, PAPER_EXTENT
from ringlight.fit.strategies.morton import morton_order
from ringlight.fit.strategies.removal_effects import removal_effects
from ringlight.fit.strategies.screen_gradients import ScreenGradients
from ringlight.fit.strategies.wander import wander_
from ringlight.models.splats import SplatModel


class MCMC:
    """Moves, adds and shakes rows.

    In each round rows that are dead, faint or not ``wanted`` by the colour model, become copies of others that are
    drawn in proportion to their screen-space gradient or opacity, and some are added likewise; copies of one row move
    apart. Rows leave in Morton order.
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
        # The shortest run has one round, too: only rounds meet the budget.
        self.last_step = max(settings.last_step(steps), 1)
        self.first_step = min(settings.first_step(steps), self.last_step - 1)
        has_round = self.last_step // settings.every > self.first_step // settings.every
        self.every = settings.every if has_round else self.last_step - self.first_step
        self.most = self._budget = settings.most_growing(steps)
        # Noise goes with the square of lengths and the rate with a length; together they are to move by a length.
        self.noise = settings.mcmc.noise * (PAPER_EXTENT / extent) ** 2
        self._gradients = ScreenGradients()

    @property
    def _by_gradient(self) -> bool:
        return self.settings.mcmc.draw == "gradient"

    def state(self) -> dict[str, Tensor]:
        return self._gradients.state() if self._by_gradient else {}

    def restore(self, state: Mapping[str, Tensor]) -> None:
        if self._by_gradient:
            self._gradients.restore(state)

    def update(self, step: int, model: SplatModel, optimizer: Optimizer, prediction: Rendering) -> None:
        if self._by_gradient and step <= self.last_step:
            self._gradients.observe(model, prediction)
        if self.first_step < step <= self.last_step and step % self.every == 0:
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
        is_first = step // self.every == self._first_round
        most = max(int(self.settings.mcmc.first_share * self._budget), 1) if is_first else self._budget
        if len(whole) > most:
            kept = self._needed(step, most, model)
        table = whole.rows(kept)
        alive = (table.opacities > self.settings.mcmc.dead) & model.color.wanted(table)
        if not bool(alive.any()):
            alive = torch.ones_like(alive)  # there is nowhere to move to
        missing = int((~alive).sum()) + self._grown(step, len(table)) - len(table)
        wanted = self._wanted(table, kept, alive)
        self._gradients.clear()
        if not missing and len(kept) == len(whole):
            return
        sources = drawn_rows(wanted, missing, generator(self.seed, step, "copies"))
        copies = 1 + torch.bincount(sources, minlength=len(table))
        split = (copies > 1).nonzero()[:, 0]
        # Those in place are new rows too: their moments belong to the Gaussian that they were.
        copied = torch.cat([split, sources])
        added = self._copies(table.rows(copied), copies[copied], step, model)
        left = kept[alive & (copies == 1)]
        rows = torch.cat([left, len(whole) + torch.arange(len(added), device=left.device)])
        optimizer.edit_rows(rows[morton_order(torch.cat([whole.means, added.means])[rows])], added)

    def _copies(self, table: Gaussians, copies: Int[Tensor, "N"], step: int, model: SplatModel) -> Gaussians:
        """Each row as one of so many in its place, or apart from the others."""
        chosen, dead = self.settings.mcmc, self.settings.mcmc.dead
        if chosen.copies == "parts":
            table = as_parts(table, copies, dead)
        else:
            table = as_copies(table, copies, dead, model.color.opacity_columns)
        return moved_apart(table, chosen.apart, generator(self.seed, step, "apart")) if chosen.apart else table

    def _wanted(self, table: Gaussians, kept: Int[Tensor, "K"], alive: Bool[Tensor, "K"]) -> Float[Tensor, "K"]:
        """How much another one is wanted at each of the ``kept`` rows that are alive; their opacities where no picture
        says anything of them."""
        if self._by_gradient:
            gradients = self._gradients.means()[kept] * alive
            if bool((gradients > 0).any()):
                return gradients
        return table.opacities * alive

    @property
    def _first_round(self) -> int:
        """Its number; rounds are numbered from the first step on."""
        return self.first_step // self.every + 1

    def _needed(self, step: int, count: int, model: SplatModel) -> Int[Tensor, "K"]:
        """The ``count`` rows, in their order, whose removal would change the pictures most."""
        effects = removal_effects(model, self.cameras, self.background, self.seed, step)
        return effects.argsort(descending=True, stable=True)[:count].sort().values

    def _grown(self, step: int, count: int) -> int:
        """How many rows this round ends with, of ``count``: the budget where it is the last in which rows are added."""
        first, last = self._first_round, self.last_step // self.every
        full = first + int(GROWN_BY * (last - first))
        share = (self._budget / count) ** (1 / max(full + 1 - step // self.every, 1)) - 1
        # Rounds up, so that a few rows grow too.
        return max(min(math.ceil(count * (1 + max(self.settings.mcmc.growth, share))), self._budget), count)
