"""Adaptive density control: clone small Gaussians, split large ones, prune faint ones (3DGS, section 5.2)."""

import math
from collections.abc import Mapping

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from ringlight import _kernels
from ringlight.core.gaussians import Gaussians
from ringlight.core.randomness import generator
from ringlight.core.rendering import Rendering
from ringlight.errors import RecipeError
from ringlight.fit.optimizer import Optimizer
from ringlight.fit.room import SHARE, most_rows
from ringlight.fit.strategies.copies import LEAST, in_share
from ringlight.fit.strategies.densify_settings import DensifySettings
from ringlight.fit.strategies.morton import morton_order
from ringlight.models.splats import SplatModel

CHILDREN = 2
SHRINK = 1.6
"""A split Gaussian's children are this much narrower (3DGS: 0.8 times the number of children)."""

WHITE_RESET_STEP = 500
"""3DGS resets the opacities once more, early, where the background is white: white floaters hide before it."""


class Densify:
    """Counts each row's mean screen-space gradient and, every so often, edits the table.

    Rows leave in Morton order, so that Gaussians that are close in space are close in memory. Removal looks at the
    opacity in force, which includes the colour model's ``wanted`` rows (RingLight's mask).
    """

    def __init__(self, settings: DensifySettings, extent: float, steps: int, seed: int, white: bool):
        self.settings, self.extent, self.seed = settings, extent, seed
        self.first_step, self.threshold = settings.first_step(steps), settings.growth(steps).threshold
        self.last_step, self.most = settings.last_step(steps), settings.most_growing(steps)
        self.reset_every = settings.paced(settings.reset_every, steps)
        self.white_reset = settings.paced(WHITE_RESET_STEP, steps) if white else None
        self._sums, self._views = torch.zeros(0), torch.zeros(0)

    def update(self, step: int, model: SplatModel, optimizer: Optimizer, prediction: Rendering) -> None:
        if step > self.last_step:
            return
        self._observe(model, prediction)
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
        return {"screen_gradients": self._sums, "views": self._views}

    def restore(self, state: Mapping[str, Tensor]) -> None:
        if state["screen_gradients"].shape != state["views"].shape:
            raise ValueError(
                f"screen-space gradients for {len(state['screen_gradients'])} rows, and views for {len(state['views'])}"
            )
        self._sums, self._views = state["screen_gradients"].clone(), state["views"].clone()  # moved by the next step

    def resets(self, step: int) -> bool:
        """Whether opacities are lowered after this step."""
        # As 3DGS: after the last round nothing would prune what a reset bares.
        if not self.reset_every or step >= self.last_step:
            return False
        return step % self.reset_every == 0 or step == self.white_reset

    def _observe(self, model: SplatModel, prediction: Rendering) -> None:
        if len(self._sums) != len(model):
            self._sums, self._views = torch.zeros(2, len(model), device=model.device)
        self._sums, self._views = self._sums.to(model.device), self._views.to(model.device)
        footprint = prediction.footprint
        if footprint is None or footprint.means2d_gradient is None:
            return
        height, width = prediction.alpha.shape[:2]
        # Half the size in pixels turns a gradient in pixels into one in normalized device coordinates.
        accumulate_screen_gradients_(
            footprint.means2d_gradient, footprint.radii, (width / 2, height / 2), self._sums, self._views
        )

    def _edit(self, step: int, model: SplatModel, optimizer: Optimizer) -> None:
        table = Gaussians.from_columns({name: column.detach() for name, column in model.columns.items()})
        widest = table.log_scales.amax(1).exp()
        strong = self._strongest(self._sums / self._views.clamp_min(1), len(table))
        small = widest <= self.settings.clone_below * self.extent
        split = strong & ~small
        keep = ~split & self._worth_keeping(step, table, widest, model)
        if not bool((keep | split).any()):  # clones come from rows that are kept
            keep[table.opacity_logits.argmax()] = True
        clones = table.rows((strong & small & keep).nonzero()[:, 0])
        children = self._children(table.rows(split.nonzero()[:, 0]), step)
        added = _joined(clones, children)
        rows = torch.cat([keep.nonzero()[:, 0], len(table) + torch.arange(len(added), device=keep.device)])
        if not self.most:
            refuse_more_than_fit(len(rows), step, model)
        optimizer.edit_rows(rows[morton_order(torch.cat([table.means, added.means])[rows])], added)
        self._sums, self._views = torch.zeros(2, len(model), device=model.device)

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


def refuse_more_than_fit(rows: int, step: int, model: SplatModel) -> None:
    """Raises RecipeError where a table that nothing bounds would not fit, before the system ends the process."""
    fit = most_rows(model)
    if rows > fit:
        raise RecipeError(
            f"step {step}: density control, which has no bound here, would make {rows:,} Gaussians, and {SHARE:.0%} of "
            f"this machine's memory holds {fit:,}; bound it with --densify.max-gaussians"
        )


def accumulate_screen_gradients_(
    gradient: Float[Tensor, "N 2"],
    radii: Float[Tensor, "N 2"],
    pixels_to_ndc: tuple[float, float],
    sums: Float[Tensor, "N"],
    views: Float[Tensor, "N"],
) -> None:
    """Add each drawn row's gradient length to ``sums`` and one to ``views``, in place."""
    if not (gradient.is_cpu and gradient.dtype == torch.float32):
        accumulate_screen_gradients_reference_(gradient, radii, pixels_to_ndc, sums, views)
        return
    _kernels.accumulate_screen_gradient(gradient.contiguous(), radii.contiguous(), *pixels_to_ndc, sums, views)


def accumulate_screen_gradients_reference_(
    gradient: Float[Tensor, "N 2"],
    radii: Float[Tensor, "N 2"],
    pixels_to_ndc: tuple[float, float],
    sums: Float[Tensor, "N"],
    views: Float[Tensor, "N"],
) -> None:
    """The same in torch, on any device."""
    drawn = radii[:, 0] > 0
    across, down = pixels_to_ndc
    lengths = torch.hypot(gradient[:, 0] * across, gradient[:, 1] * down)
    sums.add_(torch.where(drawn, lengths, 0))
    views.add_(drawn)


def _joined(first: Gaussians, second: Gaussians) -> Gaussians:
    other = second.columns()
    return Gaussians.from_columns({name: torch.cat([a, other[name]]) for name, a in first.columns().items()})
