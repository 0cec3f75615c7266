"""Density control as Markov chain Monte Carlo: who moves, how many there are, and what stays."""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Literal

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from contracts.methods import small
from ringlight.color.harmonics import SphericalHarmonics
from ringlight.color.ringlight import MASK, RingLight
from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import Gradients
from ringlight.core.rendering import Footprint, Rendering
from ringlight.errors import RecipeError
from ringlight.fit.optimizer import Optimizer
from ringlight.fit.rates import Adam, Rate
from ringlight.fit.strategies.densify_settings import DensifySettings
from ringlight.fit.strategies.mcmc import MCMC
from ringlight.fit.strategies.mcmc_settings import PAPER_EXTENT, MCMCSettings
from ringlight.fit.train import train
from ringlight.methods.splat_recipe import SplatRecipe
from ringlight.models.splats import SplatModel
from ringlight.rasterize.choose import rasterizer_for
from ringlight.rasterize.reference import ReferenceRasterizer
from ringlight.shade.passthrough import PassThrough
from small_recipes import SPLATS
from tiny_scene import tiny_scene

STILL = MCMCSettings(noise=0.0, stop=1.0, dead=0.005, first_share=1.0, apart=0.0, draw="opacity", copies="alike")
SETTINGS = DensifySettings(kind="mcmc", begin=0, every=1, max_gaussians=8, mcmc=STILL)
PREDICTION = Rendering(torch.zeros(8, 8, 3), torch.zeros(8, 8, 1), {})


def model_of(opacities: list[float]) -> SplatModel:
    """Every row has its number in its colour."""
    count = len(opacities)
    number = torch.arange(float(count))[:, None].repeat(1, 3)
    table = Gaussians(
        torch.rand(count, 3, generator=torch.Generator().manual_seed(1)),
        torch.full((count, 3), -3.0),
        torch.tensor([1.0, 0.0, 0.0, 0.0]).repeat(count, 1),
        torch.tensor(opacities).logit(),
        {"sh_dc": number, "sh_rest": torch.zeros(count, 15, 3)},
    )
    return SplatModel(table, SphericalHarmonics(), PassThrough(), ReferenceRasterizer())


def pulled(gradients: list[float]) -> Rendering:
    """A picture that drew as many of the first rows, with these gradients across it."""
    count = 5
    lengths = torch.zeros(count, 2)
    lengths[: len(gradients), 0] = torch.tensor(gradients)
    radii = torch.zeros(count, 2)
    radii[: len(gradients)] = 1.0
    footprint = Footprint(torch.zeros(count, 2), radii, lengths)
    return replace(PREDICTION, footprint=footprint)


def optimizer_of(model: SplatModel, rate: float = 0.0) -> Optimizer:
    """After a step, so that the moments of every row are others than zero."""
    optimizer = Optimizer(model, {"*": Adam(Rate.constant(rate))}, steps=100)
    optimizer.step(1, Gradients({name: torch.ones_like(p) for name, p in model.named_parameters()}))
    return optimizer


def control_of(settings: DensifySettings, extent: float = 1.0, cameras: Sequence[Camera] = ()) -> MCMC:
    return MCMC(settings, extent, cameras, torch.ones(3), steps=100, seed=0)


def numbers_of(model: SplatModel) -> list[int]:
    return model.columns["sh_dc"][:, 0].long().tolist()


def moved(model: SplatModel, settings: DensifySettings = SETTINGS, step: int = 50) -> Optimizer:
    optimizer = optimizer_of(model)
    control_of(settings).update(step, model, optimizer, PREDICTION)
    return optimizer


def test_the_dead_become_copies_of_the_living_and_only_those_lose_their_moments():
    model = model_of([0.9, 0.004, 0.5, 0.001, 0.3, 0.2, 0.6, 0.7])
    optimizer = moved(model)
    numbers = numbers_of(model)
    assert len(model) == 8
    assert not {1, 3} & set(numbers)
    assert {0, 2, 4, 5, 6, 7} <= set(numbers)
    copied = {number for number in numbers if numbers.count(number) > 1}
    for name, moments in optimizer.moments.items():
        if "columns" not in name:
            continue
        for number, row in zip(numbers, moments, strict=True):
            assert bool(row.any()) is (number not in copied) or "rest" in name, name
    opacities = model.gaussians.opacities
    for number, opacity in zip(numbers, opacities.tolist(), strict=True):
        before = [0.9, 0.004, 0.5, 0.001, 0.3, 0.2, 0.6, 0.7][number]
        assert opacity == pytest.approx(1 - (1 - before) ** (1 / numbers.count(number)), rel=1e-4)


def test_copies_move_apart_by_their_size_and_nothing_else_moves():
    opacities = [0.9, 0.004, 0.5, 0.001, 0.3, 0.2, 0.6, 0.7] * 40
    settings = replace(SETTINGS, max_gaussians=len(opacities), mcmc=replace(STILL, apart=1.0))
    model = model_of(opacities)
    places = model.columns["means"].detach().clone()
    with torch.no_grad():
        model.columns["sh_dc"].copy_(torch.arange(float(len(opacities)))[:, None].expand(-1, 3))
        model.columns["log_scales"][:, 0] -= 2.0
    moved(model, settings)
    numbers = torch.tensor(numbers_of(model))
    moves = (model.columns["means"].detach() - places[numbers]) / model.gaussians.scales
    copied = torch.bincount(numbers, minlength=len(opacities))[numbers] > 1
    assert not moves[~copied].any()
    assert moves[copied].std(0).sub(1).abs().max() < 0.2, "along each axis"
    again = model_of(opacities)
    with torch.no_grad():
        again.columns["sh_dc"].copy_(torch.arange(float(len(opacities)))[:, None].expand(-1, 3))
        again.columns["log_scales"][:, 0] -= 2.0
    moved(again, settings)
    assert torch.equal(again.columns["means"], model.columns["means"])


def test_copies_are_drawn_where_the_pictures_pull_and_dead_ones_never():
    """By the mean over the pictures since the last round that drew a row, not by its opacity."""
    model = model_of([0.9, 0.05, 0.3, 0.2, 0.001])
    only_round = replace(STILL, draw="gradient", stop=0.1)
    control = control_of(replace(SETTINGS, every=10, max_gaussians=2000, mcmc=only_round))
    optimizer = optimizer_of(model)
    for step in range(1, 11):
        control.update(step, model, optimizer, pulled([0.0, 0.3, 0.1, 0.0, 5.0] if step % 2 else [0.0, 0.3, 0.1]))
    counts = torch.bincount(torch.tensor(numbers_of(model)), minlength=5).tolist()
    assert counts[0] == counts[3] == 1
    assert counts[4] == 0
    assert counts[1] / counts[2] == pytest.approx(3, rel=0.6)


def test_where_pictures_pull_at_the_dead_alone_copies_are_drawn_by_opacity():
    model = model_of([0.9, 0.05, 0.3, 0.2, 0.001])
    only_round = replace(STILL, draw="gradient", stop=0.1)
    control, optimizer = control_of(replace(SETTINGS, every=10, max_gaussians=60, mcmc=only_round)), optimizer_of(model)
    for step in range(1, 11):
        control.update(step, model, optimizer, pulled([0.0, 0.0, 0.0, 0.0, 5.0]))
    assert len(model) == 60
    assert 4 not in numbers_of(model)


def test_where_no_picture_says_anything_copies_are_drawn_by_opacity():
    drawn = []
    for draw in ("opacity", "gradient"):
        model = model_of([0.9, 0.1, 0.5])
        moved(model, replace(SETTINGS, max_gaussians=200, mcmc=replace(STILL, draw=draw)), step=100)
        drawn.append(sorted(numbers_of(model)))
    assert drawn[0] == drawn[1]


def test_parts_are_as_opaque_as_what_was_copied_and_narrower():
    opacities = [0.9, 0.001, 0.5, 0.001]
    model = model_of(opacities)
    moved(model, replace(SETTINGS, max_gaussians=4, mcmc=replace(STILL, copies="parts", apart=1.0)))
    numbers = numbers_of(model)
    table = model.gaussians
    for number, opacity, scale in zip(numbers, table.opacities.tolist(), table.scales[:, 0].tolist(), strict=True):
        assert opacity == pytest.approx(opacities[number])
        assert scale == pytest.approx(math.exp(-3.0) / (1.6 if numbers.count(number) > 1 else 1))
    assert len(set(numbers)) == 2


@given(st.lists(st.floats(0.0011, 0.99), min_size=1, max_size=60), st.integers(1, 80), st.integers(1, 100))
def test_the_last_round_ends_with_the_budget_to_the_row(opacities: list[float], budget: int, step: int):
    """From however many it begins with, and whatever rounds came before."""
    model = model_of(opacities)
    optimizer = optimizer_of(model)
    control = control_of(replace(SETTINGS, max_gaussians=budget))
    for at in (step, 100):
        control.update(at, model, optimizer, PREDICTION)
        assert len(model) <= budget
    assert len(model) == budget == control.most


def test_growth_is_the_papers_share_and_faster_only_where_that_would_be_too_slow():
    def sizes(budget: int, first: int) -> list[int]:
        model = model_of([0.5] * first)
        optimizer = optimizer_of(model)
        control = control_of(replace(SETTINGS, every=10, max_gaussians=budget))
        counts = [first]
        for step in range(10, 101, 10):
            control.update(step, model, optimizer, PREDICTION)
            counts.append(len(model))
        return counts

    assert sizes(110, 100) == [100, 105, 110, *[110] * 8]
    short = sizes(400, 50)
    assert short[5:] == [400] * 6, "half of the rounds"
    ratios = [b / a for a, b in pairwise(short[:6])]
    assert ratios == pytest.approx([8 ** (1 / 5)] * 5, rel=0.02), "by equal shares"


@pytest.mark.parametrize(("share", "budget", "left"), [(0.5, 40, 20), (1.0, 20, 20), (0.5, 39, 19), (0.1, 5, 1)])
def test_in_the_first_round_those_go_that_the_pictures_do_not_need(share: float, budget: int, left: int):
    """Of a model whose even rows are out of sight."""
    scene = tiny_scene(views=3, size=24)
    model = small("3dgs", 40).build(scene, rasterizer_for("auto"), 3).model
    rows = torch.arange(40)
    model.load_tensors({n: t[rows] if n.startswith(model.row_prefixes) else t for n, t in model.state_dict().items()})
    with torch.no_grad():
        model.columns["means"][::2] += 1000.0
        model.columns["opacity_logits"].zero_()
    settings = replace(SETTINGS, begin=49, max_gaussians=budget, mcmc=replace(STILL, first_share=share, growth=0.0))
    control = control_of(settings, cameras=[view.camera for view in scene.train])
    kept = model.columns["means"][control._needed(50, left, model)]
    assert (kept.abs() < 100).all()
    control.update(50, model, optimizer_of(model), PREDICTION)
    assert {tuple(mean) for mean in model.columns["means"].tolist()} <= {tuple(mean) for mean in kept.tolist()}
    with torch.no_grad():
        model.columns["means"][0] += 1000.0
    control.update(51, model, optimizer_of(model), PREDICTION)
    assert (model.columns["means"].abs() > 100).any(), "in no other round"


def test_where_all_are_dead_none_moves():
    model = model_of([0.001, 0.002, 0.003])
    moved(model, replace(SETTINGS, max_gaussians=3))
    assert sorted(numbers_of(model)) == [0, 1, 2]


@pytest.mark.parametrize("step", [5, 15, 99])
def test_between_rounds_and_outside_of_them_nothing_changes(step: int):
    settings = replace(SETTINGS, begin=10, every=10, mcmc=replace(STILL, stop=0.9))
    model = model_of([0.9, 0.001])
    before = {name: tensor.clone() for name, tensor in model.state_dict().items()}
    moved(model, settings, step)
    assert all(torch.equal(tensor, before[name]) for name, tensor in model.state_dict().items())


def test_rows_that_the_colour_model_no_longer_wants_are_dead():
    training = small("ringlight-ring", 8).build(tiny_scene(views=2, size=16), rasterizer_for("auto"), 3)
    model, count = training.model, len(training.model)
    assert isinstance(model.color, RingLight)
    with torch.no_grad():
        model.columns[MASK][::4] = -20.0
        model.columns["opacity_logits"].zero_()
    control = control_of(replace(SETTINGS, max_gaussians=count))
    control.update(50, model, training.optimizer, PREDICTION)
    assert len(model) == count
    assert model.color.wanted(model.gaussians).all()


def displacements(extent: float, steps: int = 1, noise: float = 2000.0, rate: float = 1e-3) -> torch.Tensor:
    """Of faint Gaussians in a scene that is so many times as large, in shares of its extent."""
    model = model_of([0.003] * 500)
    with torch.no_grad():
        model.columns["log_scales"] += math.log(extent)
        model.columns["means"] *= extent
    before = model.columns["means"].detach().clone()
    optimizer = optimizer_of(model)
    optimizer.groups["columns.means"] = Adam(Rate.constant(rate * extent))
    settings = replace(SETTINGS, begin=1000, max_gaussians=500, mcmc=MCMCSettings(noise=noise))
    control = control_of(settings, extent)
    for step in range(1, steps + 1):
        control.update(step, model, optimizer, PREDICTION)
    return (model.columns["means"].detach() - before) / extent


def test_noise_does_the_same_to_a_scene_of_any_size():
    one = displacements(PAPER_EXTENT)
    assert one.norm(dim=1).mean() > 1e-4
    assert torch.allclose(displacements(100 * PAPER_EXTENT), one, rtol=1e-3, atol=1e-6)


def test_noise_goes_with_the_rate_of_the_centres_and_differs_from_step_to_step():
    one = displacements(PAPER_EXTENT)
    assert torch.allclose(displacements(PAPER_EXTENT, rate=3e-3), 3 * one, rtol=1e-3, atol=1e-6)
    both = displacements(PAPER_EXTENT, steps=2)
    correlation = torch.corrcoef(torch.stack([one.flatten(), (both - one).flatten()]))[0, 1]
    assert abs(correlation) < 0.1


@pytest.mark.parametrize("method", [method for method in SPLATS if method != "light-gaussian"])
def test_every_method_ends_with_its_budget_and_nothing_that_is_not_finite(method: str):
    """Those that drop too: they grow more until then."""
    recipe = small(method, 40)
    assert isinstance(recipe, SplatRecipe)
    densify = replace(recipe.densify, kind="mcmc", begin=2, every=3, stop=0.5, max_gaussians=333, drop_until=0.8)
    shares = {0.0, METHOD_SHARES.get(method, 0.0)}
    for share in shares:
        asked = replace(recipe, densify=replace(densify, drop_share=share))
        training = asked.build(tiny_scene(views=4, size=24), rasterizer_for("auto"), 3)
        for progress in train(training):
            assert progress.fault is None
            assert {"opacity", "size"} <= progress.losses.keys()
        assert training.model.counted().number == 333
        assert all(tensor.isfinite().all() for tensor in training.model.parameters())


@pytest.mark.parametrize("steps", [1, 2, 7, 60])
@pytest.mark.parametrize("begin", [None, 500])
@pytest.mark.parametrize("budget", [100, 567])
def test_runs_too_short_for_a_round_have_one(steps: int, begin: int | None, budget: int):
    """400 first Gaussians become fewer, or more."""
    recipe = small("3dgs", steps)
    assert isinstance(recipe, SplatRecipe)
    densify = replace(recipe.densify, kind="mcmc", begin=begin, every=100, max_gaussians=budget)
    scene = tiny_scene(views=4, size=24)
    training = replace(recipe, densify=densify).build(scene, rasterizer_for("auto"), 3)
    assert training.model.counted().number == 400
    for _ in train(training):
        pass
    assert training.model.counted().number == budget


METHOD_SHARES = {"ringlight-basis": 0.7, "ringlight-mirror": 0.3}


def test_penalties_are_those_of_the_settings_and_scale_with_the_loss_and_the_scene():
    scene = tiny_scene(views=2, size=16)
    recipe = small("3dgs", 8)
    asked = replace(
        recipe,
        densify=DensifySettings(kind="mcmc", mcmc=MCMCSettings(opacity_penalty=0.2, scale_penalty=0.3)),
        loss=replace(recipe.loss, scale=10.0),
    )
    training = asked.build(scene, rasterizer_for("auto"), 3)
    terms = {name: r.term(1, training.model, PREDICTION).value for name, r in training.regularizers.items()}
    table = training.model.gaussians
    assert terms["opacity"].item() == pytest.approx(10 * 0.2 * table.opacities.mean().item())
    assert terms["size"].item() == pytest.approx(10 * 0.3 * table.scales.mean().item() * PAPER_EXTENT / scene.extent)
    without = replace(asked, densify=replace(asked.densify, mcmc=MCMCSettings(opacity_penalty=0.0, scale_penalty=0.0)))
    assert not without.build(scene, rasterizer_for("auto"), 3).regularizers
    assert not recipe.build(scene, rasterizer_for("auto"), 3).regularizers


def test_without_a_stated_budget_it_is_a_quarter_of_the_pixels():
    recipe = small("3dgs", 40)
    densify = DensifySettings(kind="mcmc", begin=2, every=3)
    training = replace(recipe, densify=densify).build(tiny_scene(views=2, size=30), rasterizer_for("auto"), 3)
    assert [s.most for s in training.strategies if s.most is not None] == [225]
    assert DensifySettings(kind="mcmc", pixel_bound=False).within(7).max_gaussians == 7


def test_penalties_that_are_left_open_are_the_papers_in_its_runs_and_less_in_shorter_ones():
    settings = DensifySettings(kind="mcmc", mcmc=MCMCSettings(scale_penalty=0.2))
    for steps, expected in ((60_000, 0.01), (30_000, 0.01), (3_000, 0.001)):
        decided = settings.at_length(steps)
        assert (decided.mcmc.opacity_penalty, decided.mcmc.scale_penalty) == (pytest.approx(expected), 0.2)
        assert decided.at_length(7) == decided
    adaptive = DensifySettings(begin=3, clone_below=0.01)
    assert adaptive.at_length(3_000) == adaptive


def test_moves_end_later_than_growth_does_elsewhere_but_not_where_gaussians_are_dropped():
    settings = DensifySettings(kind="mcmc")
    assert settings.last_step(3_000) == 2_500
    assert settings.last_step(30_000) == 25_000
    assert replace(settings, drop_share=0.5).last_step(3_000) == 1_500


@pytest.mark.parametrize("kind", ["adaptive", "mcmc"])
@pytest.mark.parametrize("share", [0.0, 0.5])
def test_settings_that_decide_nothing_are_those_of_the_other_kind(kind: Literal["adaptive", "mcmc"], share: float):
    idle = DensifySettings(kind=kind, drop_share=share).without_effect()
    of_kind = {name for name, reason in idle.items() if reason == f"--densify.kind is {kind}"}
    dropping = {"drop_until", "drop_by"} | ({"drop_hidden"} if kind == "adaptive" else set())
    assert idle.keys() - of_kind == (dropping if share == 0 else set())
    assert ("drop_hidden" in of_kind) is (kind == "mcmc")
    assert ("mcmc.noise" in idle) is (kind == "adaptive")
    assert ("threshold" in idle) is (kind == "mcmc")
    assert ("stop" in idle) is (kind == "mcmc" and share == 0)
    assert not {"begin", "every", "max_gaussians", "drop_share"} & idle.keys()


def test_without_resets_what_they_decide_has_no_effect():
    """Wide Gaussians go from the first reset on, as in 3DGS."""
    idle = DensifySettings(reset_every=0).without_effect()
    assert {name: idle.get(name) for name in ("reset_opacity", "prune_scale")} == dict.fromkeys(
        ("reset_opacity", "prune_scale"), "--densify.reset-every is 0"
    )
    assert not {"reset_opacity", "prune_scale"} & DensifySettings().without_effect().keys()


@pytest.mark.parametrize(
    "name", ["growth", "apart", "first_share", "dead", "stop", "noise", "opacity_penalty", "scale_penalty"]
)
@pytest.mark.parametrize("value", [-0.1, math.inf, math.nan])
def test_settings_that_make_no_sense_are_refused(name: str, value: float):
    with pytest.raises(RecipeError, match=rf"densify\.mcmc\.{name} is .*; give (0|a share)"):
        MCMCSettings(**{name: value})
