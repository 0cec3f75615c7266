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


def test_a_rate_of_zero_freezes():
    assert Rate.constant(0.0).at(0.3) == 0.0


@pytest.mark.parametrize("ends", [(-1e-3, 1e-3), (1e-3, -1e-3), (float("nan"), 1.0), (1.0, float("inf"))])
def test_a_rate_that_is_none_is_refused(ends: tuple[float, float]):
    with pytest.raises(RecipeError, match="learning rate"):
        Rate(*ends)


def test_only_the_centres_scale_with_the_scene():
    small, large = GaussianRates().groups(1.0), GaussianRates().groups(10.0)
    changed = [name for name in small if small[name] != large[name]]
    assert changed == ["columns.means"]
    assert large["columns.means"].rate.start == pytest.approx(10 * small["columns.means"].rate.start)
