"""Dropping what adds least: who is weighed how much, who goes, when, and how many are left."""

from dataclasses import replace

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from ringlight.color.harmonics import SphericalHarmonics
from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.rendering import Rendering
from ringlight.errors import RecipeError
from ringlight.fit.optimizer import Optimizer
from ringlight.fit.rates import Adam, Rate
from ringlight.fit.strategies.blending_weights import blending_weights
from ringlight.fit.strategies.densify_settings import DensifySettings
from ringlight.fit.strategies.drop_least import DropLeast
from ringlight.models.splats import SplatModel
from ringlight.rasterize.reference import ReferenceRasterizer
from ringlight.shade.passthrough import PassThrough

SIZE = 12
AHEAD = Camera(torch.eye(4), (12.0, 12.0), (6.0, 6.0), SIZE, SIZE)
NOTHING = Rendering(torch.zeros(SIZE, SIZE, 3), torch.zeros(SIZE, SIZE, 1))


def model_of(depths: list[float], opacities: list[float]) -> SplatModel:
    """Gaussians in a line from the camera, each as wide on the picture as the others."""
    count, depth = len(depths), torch.tensor(depths)
    table = Gaussians(
        torch.stack([torch.zeros(count), torch.zeros(count), depth], 1),
        (0.1 * depth.abs()).log()[:, None].repeat(1, 3),
        torch.tensor([1.0, 0.0, 0.0, 0.0]).repeat(count, 1),
        torch.tensor(opacities).logit(),
        {"sh_dc": torch.zeros(count, 3), "sh_rest": torch.zeros(count, 15, 3)},
    )
    return SplatModel(table, SphericalHarmonics(), PassThrough(), ReferenceRasterizer())


def drop(model: SplatModel, settings: DensifySettings, steps: int) -> list[int]:
    """The numbers of rows after each step."""
    strategy = DropLeast(settings, [AHEAD], steps, torch.ones(3), 0)
    optimizer = Optimizer(model, {"*": Adam(Rate.constant(0.0))}, steps=steps)
    counts = []
    for step in range(1, steps + 1):
        strategy.update(step, model, optimizer, NOTHING)
        counts.append(len(model))
    return counts


def test_the_weights_of_all_rows_are_the_pictures_alpha():
    model = model_of([2.0, 3.0, 4.0, -1.0], [0.5, 0.9, 0.3, 0.9])
    weights = blending_weights(model, [AHEAD, AHEAD])
    alpha = model.render(AHEAD, torch.zeros(3)).alpha.detach().sum()
    assert float(weights.sum()) == pytest.approx(2 * float(alpha), rel=1e-5)
    assert weights[3] == 0  # behind the camera


def test_what_others_hide_goes_first():
    model = model_of([4.0, 2.0, 3.0], [0.9, 0.9, 0.9])
    weights = blending_weights(model, [AHEAD])
    assert weights[1] > weights[2] > weights[0]
    drop(model, DensifySettings(begin=0, every=1, drop_share=0.34), steps=100)
    assert model.columns["means"][:, 2].tolist() == [2.0]  # several rounds of one row each, but never the last row


def test_rows_keep_their_order():
    model = model_of([5.0, 2.0, 4.0, 3.0, 2.5, 2.2], [0.1, 0.2, 0.1, 0.2, 0.2, 0.2])
    before = model.columns["means"][:, 2].tolist()
    drop(model, DensifySettings(begin=0, every=1, drop_share=0.1), steps=100)
    after = model.columns["means"][:, 2].tolist()
    assert after == [depth for depth in before if depth in after]
    assert len(after) < len(before)


def test_all_is_dropped_between_the_end_of_density_control_and_the_given_share():
    counts = drop(
        model_of([2.0] * 60, [0.02] * 60), DensifySettings(begin=0, every=1, drop_share=0.5, drop_until=0.75), 100
    )
    assert counts[49] == 60
    assert counts[75] == counts[-1] <= 30
    assert len(set(counts)) == 6  # five rounds


@given(most=st.integers(1, 10_000_000), share=st.floats(0, 0.99), stop=st.floats(0, 1))
def test_the_bound_holds_once_all_are_dropped(most: int, share: float, stop: float):
    settings = DensifySettings(begin=0, max_gaussians=most, drop_share=share, stop=stop)
    strategy = DropLeast(settings, [], 1000, torch.ones(3), 0)
    count = settings.most_growing(1000)
    assert count >= most * (1 - 1e-9)
    for _ in [step for step in strategy.rounds if step <= 1000]:
        count = max(int(strategy.kept * count), 1)
    assert count <= most


@pytest.mark.parametrize(
    ("settings", "steps"),
    [
        (DensifySettings(begin=0, every=1), 200),  # the default keeps all
        (DensifySettings(drop_share=0.5), 200),  # density control has not begun
        (DensifySettings(drop_share=0.5), 1100),  # it has, but its first round is after its end
        (DensifySettings(begin=0, every=1, drop_share=0.5, stop=1.0), 200),  # it goes on to the end
    ],
)
def test_nothing_is_dropped_where_nothing_could_be_spared(settings: DensifySettings, steps: int):
    assert settings.drop_rounds(steps) == frozenset()
    assert replace(settings, max_gaussians=9).most_growing(steps) == 9
    assert drop(model_of([2.0] * 9, [0.1] * 9), settings, steps)[-1] == 9


@pytest.mark.parametrize(
    "wrong", [{"drop_share": 1.0}, {"drop_share": -0.1}, {"drop_until": 1.5}, {"drop_hidden": 1.0}]
)
def test_shares_that_are_none_are_refused(wrong: dict[str, float]):
    with pytest.raises(RecipeError, match=rf"densify\.{next(iter(wrong))} is .*; give"):
        DensifySettings(**wrong)


@pytest.mark.parametrize("bound", [0, 1, 5, 1000])
def test_the_bound_holds_where_density_control_began_with_more(bound: int):
    settings = DensifySettings(begin=0, every=1, stop=0.5, drop_share=0.6)
    free, bounded = (
        drop(model_of([2.0 + index for index in range(40)], [0.3] * 40), replace(settings, max_gaussians=most), 24)
        for most in (0, bound)
    )
    assert free[0] == bounded[0] == 40
    assert 5 < free[-1] <= 16
    assert bounded[-1] == min(free[-1], bound or free[-1])
