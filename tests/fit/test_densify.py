"""Density control: who is cloned, split, pruned; budget, resets, and that counting can resume."""

import math
from collections.abc import Callable
from dataclasses import replace

import pytest
import torch

from ringlight.color.harmonics import SphericalHarmonics
from ringlight.core.gaussians import Gaussians
from ringlight.core.rendering import Footprint, Rendering
from ringlight.errors import RecipeError
from ringlight.fit import room
from ringlight.fit.optimizer import Optimizer
from ringlight.fit.rates import Adam, Rate
from ringlight.fit.strategies.densify import Densify, refuse_more_than_fit
from ringlight.fit.strategies.densify_settings import PAPER_CLONE_BELOW, DensifySettings
from ringlight.fit.strategies.prune import Prune
from ringlight.fit.strategies.screen_gradients import (
    accumulate_screen_gradients_,
    accumulate_screen_gradients_reference_,
)
from ringlight.models.splats import SplatModel
from ringlight.rasterize.reference import ReferenceRasterizer
from ringlight.shade.passthrough import PassThrough

EXTENT = 1.0
SIZE = 8
SETTINGS = DensifySettings(threshold=0.1, begin=0, every=1, reset_every=0, stop=1.0, max_gaussians=1000)
COPYING = replace(SETTINGS, clone_below=PAPER_CLONE_BELOW)


def model_of(log_scales: list[float], opacities: list[float]) -> SplatModel:
    count = len(log_scales)
    means = torch.arange(3.0 * count).view(count, 3)
    table = Gaussians(
        means,
        torch.tensor(log_scales)[:, None].repeat(1, 3),
        torch.tensor([1.0, 0.0, 0.0, 0.0]).repeat(count, 1),
        torch.tensor(opacities).logit(),
        {"sh_dc": means / 10, "sh_rest": torch.zeros(count, 15, 3)},
    )
    return SplatModel(table, SphericalHarmonics(), PassThrough(), ReferenceRasterizer())


def rendering_with(lengths: list[float]) -> Rendering:
    """A rendering whose backward pass left these lengths, in NDC units, on the Gaussians; negative: not drawn."""
    gradient = torch.tensor([[max(length, 0.0) / (SIZE / 2), 0.0] for length in lengths])
    radii = torch.tensor([[1.0 if length >= 0 else 0.0] * 2 for length in lengths])
    alpha = torch.zeros(SIZE, SIZE, 1)
    image = torch.zeros(SIZE, SIZE, 3)
    return Rendering(image, alpha, {}, Footprint(torch.zeros(len(lengths), 2), radii, gradient))


def densify_once(model: SplatModel, lengths: list[float], settings: DensifySettings = SETTINGS, step: int = 1) -> None:
    optimizer = Optimizer(model, {"*": Adam(Rate.constant(0.0))}, steps=100)
    Densify(settings, EXTENT, steps=100, seed=0, white=False).update(step, model, optimizer, rendering_with(lengths))


SMALL, LARGE = math.log(0.005), math.log(0.05)


def test_small_ones_with_large_gradients_are_cloned_as_in_3dgs():
    model = model_of([SMALL, SMALL], [0.5, 0.5])
    densify_once(model, [0.2, 0.05], COPYING)
    means = model.columns["means"].detach()
    assert len(means) == 3
    assert (means == torch.tensor([0.0, 1.0, 2.0])).all(1).sum() == 2


def test_large_ones_with_large_gradients_become_two_narrower_ones():
    model = model_of([LARGE, SMALL], [0.5, 0.5])
    densify_once(model, [0.2, 0.0], COPYING)
    scales = model.columns["log_scales"].detach()[:, 0].sort().values
    assert len(model) == 3
    assert scales[1:].tolist() == pytest.approx([LARGE - math.log(1.6)] * 2)


def test_short_runs_split_small_ones_too():
    model = model_of([SMALL, SMALL], [0.5, 0.5])
    densify_once(model, [0.2, 0.05])
    scales = model.columns["log_scales"].detach()[:, 0].sort().values
    assert scales.tolist() == pytest.approx([SMALL - math.log(1.6)] * 2 + [SMALL])
    assert len(model.columns["means"].detach().unique(dim=0)) == 3


@pytest.mark.parametrize(("steps", "share"), [(1_000, 0.0), (29_999, 0.0), (30_000, PAPER_CLONE_BELOW)])
def test_runs_as_long_as_those_of_3dgs_clone_as_it_does(steps: int, share: float):
    assert DensifySettings().at_length(steps).clone_below == share
    assert DensifySettings(clone_below=0.3).at_length(steps).clone_below == 0.3


def test_faint_and_huge_ones_are_removed():
    model = model_of([SMALL, SMALL, math.log(0.2)], [0.5, 0.004, 0.5])
    densify_once(model, [0.0, 0.0, 0.0], DensifySettings(begin=0, every=1, reset_every=1, stop=1.0), step=2)
    assert len(model) == 1


def test_the_budget_goes_to_the_largest_gradients():
    model = model_of([SMALL] * 4, [0.5] * 4)
    densify_once(model, [0.2, 0.5, 0.3, 0.4], replace(COPYING, max_gaussians=6))
    counts = [(model.columns["means"].detach()[:, 0] == 3.0 * row).sum().item() for row in range(4)]
    assert counts == [1, 2, 1, 2]


def test_the_budget_is_the_pixels_of_a_photograph_unless_given():
    assert DensifySettings().within(160_000).max_gaussians == 160_000
    assert DensifySettings(max_gaussians=7).within(160_000).max_gaussians == 7


def test_without_the_pixels_nothing_bounds_the_growth():
    unbounded = DensifySettings(threshold=0.1, begin=0, every=1, stop=1.0, pixel_bound=False)
    assert unbounded.within(1) == unbounded
    assert replace(unbounded, max_gaussians=7).within(1).max_gaussians == 7
    model = model_of([SMALL] * 4, [0.5] * 4)
    densify_once(model, [0.2, 0.5, 0.3, 0.4], unbounded)
    assert len(model) == 8


def test_growth_without_a_bound_is_refused_before_memory_is_out(monkeypatch: pytest.MonkeyPatch):
    unbounded = DensifySettings(threshold=0.1, begin=0, every=1, stop=1.0, pixel_bound=False)
    model = model_of([SMALL] * 4, [0.5] * 4)
    monkeypatch.setattr(room, "machine_memory", lambda: 7 * 2 * (room.COPIES * 4 * 59 + room.WORK_BYTES))
    with pytest.raises(RecipeError, match=r"step 1: .* would make 8 Gaussians, and 50% .* holds 7; bound it"):
        densify_once(model, [0.2, 0.5, 0.3, 0.4], unbounded)
    assert len(model) == 4


def test_a_guard_leaves_room_for_fewer(monkeypatch: pytest.MonkeyPatch):
    model = model_of([SMALL] * 4, [0.5] * 4)
    monkeypatch.setattr(room, "machine_memory", lambda: 8 * 2 * (room.COPIES * 4 * 59 + room.WORK_BYTES))
    refuse_more_than_fit(8, 1, model)
    with pytest.raises(RecipeError, match="would make 8 Gaussians"):
        refuse_more_than_fit(8, 1, model, guarded=True)


def test_never_everything_is_removed():
    model = model_of([SMALL] * 3, [0.001, 0.003, 0.002])
    densify_once(model, [0.0, 0.0, 0.0])
    assert model.columns["opacity_logits"].sigmoid().tolist() == pytest.approx([0.003])


def test_faint_ones_with_large_gradients_do_not_empty_the_table():
    model = model_of([SMALL] * 3, [0.001, 0.003, 0.002])
    densify_once(model, [0.5, 0.0, 0.5], COPYING)
    assert model.columns["opacity_logits"].sigmoid().tolist() == pytest.approx([0.003])


def test_no_reset_follows_the_last_round():
    model = model_of([SMALL], [0.5])
    densify_once(model, [0.0], DensifySettings(begin=10_000, reset_every=25, stop=0.5), step=50)
    assert model.columns["opacity_logits"].sigmoid().tolist() == pytest.approx([0.5])


@pytest.mark.parametrize(
    "wrong",
    [{"every": 0}, {"reset_every": -1}, {"max_gaussians": -1}, {"reset_opacity": 1.0}, {"prune_opacity": 1.0}],
)
def test_settings_that_cannot_work_are_refused(wrong: dict[str, float]):
    with pytest.raises(RecipeError, match=rf"densify\.{next(iter(wrong))} is .*; "):
        DensifySettings(**wrong)


def test_opacity_resets_lower_but_never_raise():
    model = model_of([SMALL, SMALL], [0.5, 0.006])
    settings = DensifySettings(begin=10_000, reset_every=2, stop=1.0)
    densify_once(model, [0.0, 0.0], settings, step=2)
    assert model.columns["opacity_logits"].sigmoid().tolist() == pytest.approx([0.01, 0.006])


def test_steps_in_proportion_are_those_of_thirty_thousand():
    settings = DensifySettings(begin=500, reset_every=3000, in_proportion=True)
    found = {}
    for steps in (300, 3000, 30_000, 60_000):
        strategy = Densify(settings.at_length(steps), EXTENT, steps, seed=0, white=True)
        found[steps] = (strategy.first_step, strategy.white_reset, strategy.reset_every)
    assert found == {
        300: (5, 5, 30),
        3000: (50, 50, 300),
        30_000: (500, 500, 3000),
        60_000: (500, 500, 3000),
    }
    assert settings.at_length(3000).at_length(3000) == settings.at_length(3000)
    as_3dgs = Densify(replace(settings, in_proportion=False), EXTENT, 3000, seed=0, white=True)
    assert (as_3dgs.first_step, as_3dgs.white_reset, as_3dgs.reset_every) == (500, 500, 3000)
    assert Densify(replace(settings, reset_every=0), EXTENT, 3000, seed=0, white=True).reset_every == 0


def test_nothing_changes_after_the_last_step():
    model = model_of([SMALL, LARGE], [0.5, 0.001])
    densify_once(model, [0.9, 0.9], DensifySettings(threshold=0.1, begin=0, every=1, stop=0.5), step=51)
    assert len(model) == 2


def test_the_screen_space_gradient_is_a_mean_over_the_views_that_saw_the_gaussian():
    length, views = torch.zeros(2), torch.zeros(2)
    for lengths in ([0.4, 0.2], [0.2, -1.0]):
        footprint = rendering_with(lengths).footprint
        accumulate_screen_gradients_(footprint.means2d_gradient, footprint.radii, (SIZE / 2, SIZE / 2), length, views)
    assert (length / views).tolist() == pytest.approx([0.3, 0.2])
    assert views.tolist() == [2.0, 1.0]


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), -float("inf")])
@pytest.mark.parametrize("by", [accumulate_screen_gradients_, accumulate_screen_gradients_reference_])
def test_a_gradient_that_is_not_finite_does_not_stay_in_the_mean(by: Callable[..., None], bad: float):
    sums, views = torch.zeros(3), torch.zeros(3)
    for gradient in ([[3.0, 4.0], [bad, 0.0], [0.0, bad]], [[3.0, 4.0]] * 3):
        by(torch.tensor(gradient), torch.ones(3, 2), (1.0, 1.0), sums, views)
    assert sums.tolist() == [10.0, 5.0, 5.0]
    assert views.tolist() == [2.0, 2.0, 2.0]


def test_counting_resumes():
    model = model_of([SMALL, SMALL], [0.5, 0.5])
    optimizer = Optimizer(model, {"*": Adam(Rate.constant(0.0))}, steps=100)
    settings = DensifySettings(threshold=0.1, begin=1, every=3, reset_every=0, stop=1.0)
    first = Densify(settings, EXTENT, steps=100, seed=0, white=False)
    first.update(1, model, optimizer, rendering_with([0.3, 0.0]))
    second = Densify(settings, EXTENT, steps=100, seed=0, white=False)
    second.restore(first.state())
    second.update(2, model, optimizer, rendering_with([0.0, 0.0]))
    second.update(3, model, optimizer, rendering_with([0.03, 0.0]))
    assert len(model) == 3


def test_prune_drops_faint_rows_and_waits_for_its_turn_which_may_not_come():
    model = model_of([SMALL] * 3, [0.5, 0.001, 0.5])
    optimizer = Optimizer(model, {"*": Adam(Rate.constant(0.0))}, steps=100)
    for until in (15, None):
        prune = Prune(begin=10, every=5, opacity=0.005, until=until)
        for step, rows in ((5, 3), (12, 3), (15, 3 if until else 2)):
            prune.update(step, model, optimizer, rendering_with([0.0] * len(model)))
            assert len(model) == rows


def test_rows_leave_in_morton_order_with_their_columns():
    model = model_of([SMALL] * 5, [0.5] * 5)
    densify_once(model, [0.2] * 5, COPYING)
    means, colors = model.columns["means"].detach(), model.columns["sh_dc"].detach()
    assert len(model) == 10
    assert torch.equal(means[:, 0].sort().values, means[:, 0])
    assert torch.allclose(colors, means / 10)


@pytest.mark.parametrize(("steps", "begin"), [(30_000, 500), (5_000, 500), (3_000, 300), (9, 0)])
def test_it_begins_early_in_short_runs(steps: int, begin: int):
    assert DensifySettings().first_step(steps) == begin
    assert DensifySettings().at_length(steps).begin == begin
    assert DensifySettings(begin=40).at_length(steps).begin == 40
    densify = Densify(DensifySettings(every=1), EXTENT, steps=steps, seed=0, white=False)
    assert densify.first_step == begin
