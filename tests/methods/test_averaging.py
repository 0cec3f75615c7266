"""A run that keeps the mean of its last models keeps that, and nothing moves their numbers about meanwhile."""

from dataclasses import replace
from typing import Any

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from contracts.methods import small
from ringlight.errors import RecipeError
from ringlight.fit.strategies.average_at_end import AverageAtEnd
from ringlight.fit.train import Training, train
from ringlight.methods.averaging import AVERAGED, check_average, first_averaged
from ringlight.methods.relight_recipe import relight_recipe
from ringlight.methods.splat_recipe import SplatRecipe
from ringlight.methods.table import METHODS
from ringlight.rasterize.choose import rasterizer_for
from tiny_scene import tiny_scene

STEPS = 40
SPLATTING = sorted(name for name, recipe in METHODS.items() if isinstance(recipe, SplatRecipe))
ON_BY_DEFAULT = {"ringlight-ring", "ringlight-mirror"}
"""Of those that splat: what these learn settles least (docs/experiments/averaged-models.md)."""


@given(st.floats(0, 1), st.integers(1, 100_000), st.integers(0, 100_000))
def test_the_mean_is_of_the_last_steps_after_all_that_moves_numbers(average: float, steps: int, reshaped: int) -> None:
    first = first_averaged(average, steps, reshaped)
    if first is None:
        assert average == 0 or round(average * steps) <= 1 or reshaped >= steps - 1
    else:
        assert reshaped < first < steps
        taken, asked = steps - first + 1, round(average * steps)
        assert taken == min(asked, steps - reshaped), "all of the share that comes after"


def test_it_begins_after_the_last_gaussians_are_dropped() -> None:
    ring = METHODS["ringlight-ring"]
    assert isinstance(ring, SplatRecipe)
    assert replace(ring, steps=3000).averaged_from == 2701
    assert replace(ring, steps=3000, average=1.0).averaged_from == 2102
    assert replace(ring, steps=3000, average=1.0).densify.drop_rounds(3000) == {1501, 1651, 1801, 1951, 2101}


@pytest.mark.parametrize("average", [-0.1, 1.1, float("nan"), float("inf")])
def test_what_is_no_share_is_refused(average: float) -> None:
    with pytest.raises(RecipeError, match=r"average is .*; give a share of the run"):
        check_average(average)


@pytest.mark.parametrize("name", SPLATTING)
def test_methods_average_a_tenth_or_nothing(name: str) -> None:
    recipe = METHODS[name]
    assert recipe.average == (AVERAGED if name in ON_BY_DEFAULT else 0)
    with pytest.raises(RecipeError, match="average is 2"):
        replace(recipe, average=2.0)


@pytest.mark.parametrize("name", [name for name in SPLATTING if name != "light-gaussian"])
def test_the_kept_model_is_the_mean_of_those_since_density_control(name: str) -> None:
    recipe = small(name, STEPS)
    assert isinstance(recipe, SplatRecipe)
    first = replace(recipe, average=1.0).averaged_from
    assert first is not None
    plain, averaging = (_training(replace(recipe, average=1.0)) for _ in range(2))
    plain.strategies = tuple(strategy for strategy in plain.strategies if not isinstance(strategy, AverageAtEnd))
    models, averaged = _after_each_step(plain), _after_each_step(averaging)
    for key, kept in averaged[-1].items():
        mean = torch.stack([model[key].double() for model in models[first - 1 :]]).mean(0)
        torch.testing.assert_close(kept.double(), mean, rtol=1e-4, atol=1e-5)


def test_light_gaussian_which_rounds_its_last_model_refuses_it() -> None:
    with pytest.raises(RecipeError, match=r"average is 0.1, and light-gaussian rounds .* light-gaussian --from"):
        replace(METHODS["light-gaussian"], average=0.1)


def test_an_average_that_nothing_is_left_for_has_no_effect() -> None:
    recipe = METHODS["3dgs"]
    assert isinstance(recipe, SplatRecipe)
    late = replace(recipe, steps=100, average=0.1, densify=replace(recipe.densify, stop=1.0))
    assert late.averaged_from is None
    assert late.without_effect()["average"].startswith("fewer than two of the last 10 steps, of 100,")
    alone = replace(late, average=0.01, densify=recipe.densify)
    assert alone.averaged_from is None
    assert alone.without_effect()["average"].startswith("fewer than two of the last 1 step, of 100,")
    assert "average" not in replace(late, average=0.0).without_effect()


@pytest.mark.parametrize("name", ["ringlight-ring", "ringlight-mirror", "ringlight-basis"])
@pytest.mark.parametrize("kind", ["adaptive", "mcmc"])
def test_a_light_that_is_learned_anew_is_the_last_one_and_no_row_is_moved(name: str, kind: str) -> None:
    recipe: Any = METHODS[name]
    relit = relight_recipe(replace(recipe, average=1.0, densify=replace(recipe.densify, kind=kind)), 300)
    assert relit.averaged_from is None
    assert relit.densify.last_step(300) == 0
    assert not relit.densify.drop_rounds(300)


def _training(recipe: SplatRecipe) -> Training:
    return recipe.build(tiny_scene(views=4, size=16), rasterizer_for("auto"), 3)


def _after_each_step(training: Training) -> list[dict[str, Tensor]]:
    return [
        {name: parameter.detach().clone() for name, parameter in training.model.named_parameters()}
        for _ in train(training)
    ]
