"""3DGS at its own length, and the rates that suit shorter runs."""

import dataclasses

import pytest

from ringlight.fit.rates import Adam
from ringlight.methods.recipe import recipe_from_dict, recipe_to_dict
from ringlight.methods.table import METHODS
from ringlight.methods.three_dgs import PAPER, ThreeDGSRecipe
from ringlight.rasterize.choose import rasterizer_for
from tiny_scene import tiny_scene


def groups_of(recipe: ThreeDGSRecipe) -> dict[str, Adam]:
    return recipe.build(tiny_scene(), rasterizer_for("auto"), 0).optimizer.groups


def rates_of(recipe: ThreeDGSRecipe, last: float = 1.0) -> dict[str, tuple[float, float]]:
    """At the start, and at the share ``last`` of the run."""
    return {name: (group.rate.at(0.0), group.rate.at(last)) for name, group in groups_of(recipe).items()}


HELD = 0.75
"""Share of a short run in which rates do not fall."""


def test_at_its_own_length_the_default_has_the_papers_rates():
    whole = rates_of(ThreeDGSRecipe())
    paper = rates_of(PAPER)
    assert whole.pop("columns.opacity_logits") == (0.025, 0.025)
    assert paper.pop("columns.opacity_logits") == (0.05, 0.05)
    assert whole == paper
    extent = whole.pop("columns.means")[0] / 1.6e-4
    assert extent > 0
    assert whole == {
        "columns.log_scales": (5e-3, 5e-3),
        "columns.quats": (1e-3, 1e-3),
        "columns.sh_dc": (2.5e-3, 2.5e-3),
        "columns.sh_rest": (1.25e-4, 1.25e-4),
    }


@pytest.mark.parametrize(("steps", "rate"), [(30_000, 1.25e-4), (15_000, 2.5e-4), (3_000, 1.25e-3), (700, 2.5e-3)])
def test_harmonics_of_a_shorter_run_learn_faster(steps: int, rate: float):
    assert rates_of(ThreeDGSRecipe(steps=steps), HELD)["columns.sh_rest"] == (pytest.approx(rate), pytest.approx(rate))


@pytest.mark.parametrize(("steps", "rate"), [(30_000, 2.5e-3), (20_000, 3.75e-3), (15_000, 5e-3), (700, 5e-3)])
def test_base_colours_of_a_shorter_run_learn_faster(steps: int, rate: float):
    assert rates_of(ThreeDGSRecipe(steps=steps), HELD)["columns.sh_dc"] == (pytest.approx(rate), pytest.approx(rate))


def test_rates_of_a_shorter_run_fall_at_its_end():
    shorter, whole = groups_of(ThreeDGSRecipe(steps=29_999)), groups_of(ThreeDGSRecipe())
    for name in ("columns.sh_dc", "columns.sh_rest", "columns.opacity_logits", "columns.quats"):
        assert shorter[name].rate.at(1.0) == pytest.approx(shorter[name].rate.at(0.0) / 10)
        assert whole[name].rate.at(1.0) == whole[name].rate.at(0.0)


@pytest.mark.parametrize("steps", [700, 7_000])
def test_the_paper_takes_its_rates_at_any_length(steps: int):
    assert rates_of(dataclasses.replace(PAPER, steps=steps)) == rates_of(PAPER)


def test_a_rate_that_is_stated_is_taken():
    assert rates_of(ThreeDGSRecipe(steps=700, sh_rest_rate=0.0))["columns.sh_rest"] == (0.0, 0.0)


def test_a_run_records_the_rates_it_takes():
    recipe = ThreeDGSRecipe(steps=3_000)
    settled, why = recipe.settled(tiny_scene(), rasterizer_for("auto"), 0)
    assert why is None
    assert (settled.sh_rate, settled.sh_rest_rate) == (pytest.approx(5e-3), pytest.approx(1.25e-3))
    assert None not in dataclasses.asdict(settled.rates).values()
    assert recipe_from_dict(ThreeDGSRecipe, recipe_to_dict(settled)) == settled
    assert rates_of(settled) == rates_of(recipe)


def test_both_are_by_name():
    assert METHODS["3dgs"] == ThreeDGSRecipe()
    assert METHODS["3dgs-paper"] == PAPER
