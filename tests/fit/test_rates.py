"""Rates are log-linear, and constant where start and end agree."""

import pytest

from ringlight.errors import RecipeError
from ringlight.fit.rates import GaussianRates, Rate


def test_log_linear_between_its_ends():
    rate = Rate(1e-2, 1e-4)
    assert rate.at(0.0) == pytest.approx(1e-2)
    assert rate.at(0.5) == pytest.approx(1e-3)
    assert rate.at(1.0) == pytest.approx(1e-4)


def test_progress_outside_the_run_is_clamped():
    assert Rate(1e-2, 1e-4).at(-1.0) == pytest.approx(1e-2)
    assert Rate(1e-2, 1e-4).at(2.0) == pytest.approx(1e-4)


def test_a_held_rate_falls_at_the_end():
    rate = Rate(1e-2, 1e-4, hold=0.75)
    assert rate.at(0.0) == rate.at(0.75) == 1e-2
    assert rate.at(0.875) == pytest.approx(1e-3)
    assert rate.at(1.0) == pytest.approx(1e-4)


@pytest.mark.parametrize("hold", [-0.1, 1.0, float("nan")])
def test_a_rate_that_is_held_for_no_share_of_the_run_is_refused(hold: float):
    with pytest.raises(RecipeError, match="held for"):
        Rate(1e-2, 1e-4, hold)


def test_opacities_and_rotations_fall_only_where_that_is_asked_for():
    kept = GaussianRates(hold=1.0).at_length(100).groups(1.0)
    assert kept["columns.opacity_logits"].rate == Rate.constant(0.025)
    fallen = GaussianRates(hold=0.5).at_length(100).groups(1.0)
    assert fallen["columns.opacity_logits"].rate.at(0.5) == 0.025
    assert fallen["columns.opacity_logits"].rate.at(1.0) == pytest.approx(0.0025)
    assert fallen["columns.quats"].rate.at(1.0) == pytest.approx(1e-4)
    with pytest.raises(RecipeError, match=r"rates\.hold is 1\.5"):
        GaussianRates(hold=1.5)


def test_a_rate_of_zero_freezes():
    assert Rate.constant(0.0).at(0.3) == 0.0
    assert [Rate(0.0, 5e-3, hold).at(progress) for hold in (0.0, 0.5) for progress in (0.0, 0.7, 1.0)] == [0.0] * 6


@pytest.mark.parametrize("ends", [{"means_end": 0.0}, {"scales_end": 0.0}, {"scales": 1e-3, "scales_end": 0.0}])
def test_a_rate_that_falls_to_zero_is_refused_by_its_name(ends: dict[str, float]):
    """A rate that falls by factors would be 0 from the first step on."""
    with pytest.raises(RecipeError, match=r"rates\.(means|scales)_end is 0, .* above 0"):
        GaussianRates(**ends).at_length(100).groups(1.0)
    with pytest.raises(RecipeError, match="to 0"):
        Rate(1e-3, 0.0)
    assert GaussianRates(means=0.0, means_end=0.0).at_length(100).groups(1.0)["columns.means"].rate.at(1.0) == 0.0


@pytest.mark.parametrize("ends", [(-1e-3, 1e-3), (1e-3, -1e-3), (float("nan"), 1.0), (1.0, float("inf"))])
def test_a_rate_that_is_none_is_refused(ends: tuple[float, float]):
    with pytest.raises(RecipeError, match="learning rate"):
        Rate(*ends)


def test_only_the_centres_scale_with_the_scene():
    rates = GaussianRates().at_length(30_000)
    small, large = rates.groups(1.0), rates.groups(10.0)
    changed = [name for name in small if small[name] != large[name]]
    assert changed == ["columns.means"]
    assert large["columns.means"].rate.start == pytest.approx(10 * small["columns.means"].rate.start)


def test_what_is_left_to_the_length_is_3dgs_at_its_own_length():
    assert GaussianRates().at_length(30_000) == GaussianRates(means=1.6e-4, scales=5e-3, hold=1.0)
    assert GaussianRates().at_length(100_000) == GaussianRates().at_length(30_000)


def test_a_shorter_run_begins_faster_up_to_a_bound():
    assert GaussianRates().at_length(15_000) == GaussianRates(means=3.2e-4, scales=1e-2, hold=0.75)
    assert GaussianRates().at_length(1_000) == GaussianRates(means=3.2e-4, scales=2e-2, hold=0.75)


@pytest.mark.parametrize("steps", [1, 700, 30_000])
def test_what_is_stated_does_not_depend_on_the_length(steps: int):
    stated = GaussianRates(means=1e-5, scales=0.0, hold=0.4)
    assert stated.at_length(steps) == stated


def test_rates_that_are_left_open_are_not_trained_with():
    with pytest.raises(RecipeError, match="length"):
        GaussianRates().groups(1.0)
