"""The time of missing runs: by the nearest kin that is measured."""

import pytest
from samples import sample_report

from ringlight.runs.expected_time import Expected, core_seconds, usual

CHAIR = Expected("chair", "3dgs", "3dgs", 100, sample_report(train_cpu_seconds=10.0, choosing_cpu_seconds=0.0), False)
LEGO = Expected("lego", "3dgs", "3dgs", 100, sample_report(train_cpu_seconds=30.0, choosing_cpu_seconds=0.0), False)


def missing(scene: str, name: str, steps: int = 1000) -> Expected:
    return Expected(scene, name, name, steps, None, True)


def test_nothing_missing_takes_no_time():
    assert core_seconds([CHAIR, LEGO]) == (0.0, True)


@pytest.mark.parametrize(
    ("scene", "name", "rate"),
    [("lego", "3dgs", 0.3), ("toaster", "3dgs", 0.2), ("lego", "putt", 0.2 * usual("putt") / usual("3dgs"))],
)
def test_the_same_scene_tells_better_than_another_and_that_better_than_another_method(
    scene: str, name: str, rate: float
):
    seconds, told = core_seconds([CHAIR, LEGO, missing(scene, name)])
    assert seconds == pytest.approx(1000 * rate)
    assert told


def test_without_any_that_is_measured_the_readme_tells():
    assert core_seconds([missing("lego", "3dgs", 50)]) == (pytest.approx(50 * usual("3dgs")), False)
