"""Adaptive density control: clone small Gaussians, split large ones, prune faint ones (3DGS, section 5.2)."""

import math
from collections.abc import Mapping

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from ringlight.core.gaussians import Gaussians
from ringlight.core.randomness import generator
from ringlight.core.rendering import Rendering
from ringlight.errors import RecipeError
from ringlight.fit.optimizer import Optimizer
from ringlight.fit.room import SHARE, most_rows
from ringlight.fit.strategies.copies import LEAST, SHRINK, in_share
from ringlight.fit.strategies.densify_settings import DensifySettings
from ringlight.fit.strategies.morton import morton_order
from ringlight.fit.strategies.screen_gradients import ScreenGradients
from ringlight.models.splats import SplatModel

CHILDREN = 2

WHITE_RESET_STEP = 500
"""3DGS resets the opacities once more, early, where the background is white: white floaters hide before it."""


class Densify:
    """Counts each row's mean screen-space gradient and, every so often, edits the table.

    Rows leave in Morton order, so that Gaussians that are close in space are close in memory. Removal looks at the
    opacity in force, which includes the colour model's ``wanted`` rows (RingLight's mask).
    """

    def __init__(
        self, settings: DensifySettings, extent: float, steps: int, seed: int, white: bool, guarded: bool = False
    ):
        self.settings, self.extent, self.seed, self.guarded = settings, extent, seed, guarded
        self.first_step, self.threshold = settings.first_step(steps), settings.growth(steps).threshold
        self.last_step, self.most = settings.last_step(steps), settings.most_growing(steps)
        self.clone_below = settings.cloned_below(steps)
        self.reset_every = settings.paced(settings.reset_every, steps)
        self.white_reset = settings.paced(WHITE_RESET_STEP, steps) if white else None
        self._gradients = ScreenGradients()

    def update(self, step: int, model: SplatModel, optimizer: Optimizer, prediction: Rendering) -> None:
        if step > self.last_step:
            return
        self._gradients.observe(model, prediction)
        if step > self.first_step and step % self.settings.every == 0:
            self._edit(step, model, optimizer)
        if self.resets(step):
            self._lower(model, optimizer)

    def _lower(self, model: SplatModel, optimizer: Optimizer) -> None:
        """Opacities to at most what a reset leaves, and in the same share what is added to them towards a camera."""
        ceiling = math.log(self.settings.reset_opacity / (1 - self.settings.reset_opacity))
        logits = model.columns["opacity_logits"].detach()
        lowered = logits.clamp_max(ceiling)
        share = lowered.sigmoid() / logits.sigmoid().clamp_min(LEAST)
        for name in model.color.opacity_columns:
            optimizer.replace(f"columns.{name}", in_share(model.columns[name].detach(), share))
        optimizer.replace("columns.opacity_logits", lowered)

    def state(self) -> dict[str, Tensor]:
        return self._gradients.state()

    def restore(self, state: Mapping[str, Tensor]) -> None:
        self._gradients.restore(state)

    def resets(self, step: int) -> bool:
        """Whether opacities are lowered after this step."""
        # As 3DGS: after the last round nothing would prune what a reset bares.
        if not self.reset_every or step >= self.last_step:
            return False
        return step % self.reset_every == 0 or step == self.white_reset

    def _edit(self, step: int, model: SplatModel, optimizer: Optimizer) -> None:
        table = Gaussians.from_columns({name: column.detach() for name, column in model.columns.items()})
        widest = table.log_scales.amax(1).exp()
        strong = self._strongest(self._gradients.means(), len(table))
        small = widest <= self.clone_below * self.extent
        split = strong & ~small
        keep = ~split & self._worth_keeping(step, table, widest, model)
        if not bool((keep | split).any()):  # clones come from rows that are kept
            keep[table.opacity_logits.argmax()] = True
        clones = table.rows((strong & small & keep).nonzero()[:, 0])
        children = self._children(table.rows(split.nonzero()[:, 0]), step)
        added = _joined(clones, children)
        rows = torch.cat([keep.nonzero()[:, 0], len(table) + torch.arange(len(added), device=keep.device)])
        if not self.most:
            refuse_more_than_fit(len(rows), step, model, self.guarded)
        optimizer.edit_rows(rows[morton_order(torch.cat([table.means, added.means])[rows])], added)
        self._gradients.clear()

    def _strongest(self, means: Float[Tensor, "N"], count: int) -> Bool[Tensor, "N"]:
        """Rows over the threshold; where all would exceed the budget, those with the largest gradient."""
        strong = means > self.threshold
        room = max(self.most - count, 0) if self.most else count
        if int(strong.sum()) > room:
            chosen = means.argsort(descending=True, stable=True)[:room]
            strong = torch.zeros_like(strong).index_fill_(0, chosen, True) & strong
        return strong

    def _worth_keeping(
        self, step: int, table: Gaussians, widest: Float[Tensor, "N"], model: SplatModel
    ) -> Bool[Tensor, "N"]:
        keep = (table.opacities >= self.settings.prune_opacity) & model.color.wanted(table)
        # 3DGS also prunes by size on the screen, but its counters are cleared just before they are read.
        if self.reset_every and step > self.reset_every:
            keep &= widest <= self.settings.prune_scale * self.extent
        return keep

    def _children(self, parents: Gaussians, step: int) -> Gaussians:
        """Two narrower Gaussians for each parent, at places drawn from it."""
        rows = torch.arange(len(parents), device=parents.means.device).repeat_interleave(CHILDREN)
        table = parents.rows(rows)
        noise = torch.randn(len(rows), 3, generator=generator(self.seed, step, "split")).to(table.means)
        offsets = (table.rotations @ (noise * table.scales)[..., None])[..., 0]
        columns = table.columns() | {
            "means": table.means + offsets,
            "log_scales": table.log_scales - math.log(SHRINK),
        }
        return Gaussians.from_columns(columns)


def refuse_more_than_fit(rows: int, step: int, model: SplatModel, guarded: bool = False) -> None:
    """Raises RecipeError where a table that nothing bounds would not fit, before the system ends the process.

    ``guarded``: an earlier state is kept besides.
    """
    fit = most_rows(model, guarded=guarded)
    if rows > fit:
        raise RecipeError(
            f"step {step}: density control, which has no bound here, would make {rows:,} Gaussians, and {SHARE:.0%} of "
            f"this machine's memory holds {fit:,}; bound it with --densify.max-gaussians"
        )


def _joined(first: Gaussians, second: Gaussians) -> Gaussians:
    other = second.columns()
    return Gaussians.from_columns({name: torch.cat([a, other[name]]) for name, a in first.columns().items()})
