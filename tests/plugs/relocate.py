"""A plug: a densifier that moves dead Gaussians to where others are, and lets centres wander (Kheradmand et al. 2024).

3D Gaussian Splatting as Markov Chain Monte Carlo, sections 3.2 and 3.3; the number of Gaussians stays.
"""

from collections.abc import Mapping

import torch
from torch import Tensor

from ringlight.core.gaussians import Gaussians
from ringlight.core.randomness import generator
from ringlight.core.rendering import Rendering
from ringlight.fit.optimizer import Optimizer
from ringlight.models.splats import SplatModel

DEAD = 0.005
"""Opacity below which a Gaussian is moved."""


class Relocate:
    """Every ``every`` steps moves the dead; every step adds noise to faint centres, ``noise`` world units at most."""

    def __init__(self, every: int, noise: float, seed: int):
        self.every, self.noise, self.seed = every, noise, seed
        self._moved = torch.zeros((), dtype=torch.int64)

    most: int | None = None

    def update(self, step: int, model: SplatModel, optimizer: Optimizer, prediction: Rendering) -> None:
        if step % self.every == 0:
            self._relocate(step, model, optimizer)
        with torch.no_grad():
            means, opacities = model.columns["means"], model.gaussians.opacities
            draw = torch.randn(means.shape, generator=generator(self.seed, step, "wander")).to(means)
            means += self.noise * (1 - opacities)[:, None] ** 100 * draw

    def state(self) -> dict[str, Tensor]:
        return {"moved": self._moved}

    def restore(self, state: Mapping[str, Tensor]) -> None:
        self._moved = state["moved"].clone()

    @torch.no_grad()
    def _relocate(self, step: int, model: SplatModel, optimizer: Optimizer) -> None:
        table = Gaussians.from_columns({name: column.detach() for name, column in model.columns.items()})
        dead = (table.opacities < DEAD).nonzero()[:, 0]
        alive = (table.opacities >= DEAD).nonzero()[:, 0]
        if not len(dead) or not len(alive):
            return
        draw = generator(self.seed, step, "relocate")
        chosen = alive[torch.multinomial(table.opacities[alive].cpu(), len(dead), True, generator=draw).to(alive)]
        rows = torch.arange(len(table), device=dead.device).index_copy(0, dead, chosen)
        copies = torch.bincount(rows, minlength=len(table))[rows]
        optimizer.edit_rows(rows)
        # As many in one place let as much light through as the one did (equation 9).
        together = 1 - (1 - model.gaussians.opacities) ** (1 / copies)
        logits = together.clamp(1e-4, 1 - 1e-4).logit()
        optimizer.replace("columns.opacity_logits", logits)
        self._moved += len(dead)
