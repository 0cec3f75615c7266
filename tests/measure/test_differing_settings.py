"""A comparison says in which settings its runs differ, if they are of one method and scene."""

from samples import sample_report

from ringlight.measure.differing_settings import MOST_TOLD, differing_settings
from ringlight.measure.table import ResultsTable


def test_values_stand_with_the_runs_that_have_them():
    runs = [
        ("a", sample_report(settings={"rays": "512", "steps": "900"})),
        ("b", sample_report(settings={"steps": "900", "downscale": "2"})),
        ("c", sample_report(settings={"rays": "512", "steps": "900"})),
    ]
    lines = (
        "toaster_200: rays is 512 in a, c; the default in b.",
        "toaster_200: downscale is the default in a, c; 2 in b.",
    )
    assert differing_settings(runs) == lines
    assert ResultsTable(runs).notes()[:2] == lines


def test_other_scenes_methods_and_records_of_before_say_nothing():
    first = sample_report(settings={"rays": "512"})
    others = [
        sample_report(settings={}, scene="carpaint"),
        sample_report(settings={}, method="putt"),
        sample_report(settings={}, preset="3dgs-paper"),
        sample_report(settings=None),
        sample_report(settings={"rays": "512"}, seed=1),
    ]
    assert differing_settings([("a", first), *((str(index), other) for index, other in enumerate(others))]) == ()


def test_of_many_the_rest_is_counted():
    many = {f"setting{index}": "1" for index in range(MOST_TOLD + 2)}
    lines = differing_settings([("a", sample_report(settings=many)), ("b", sample_report(settings={}))])
    assert len(lines) == MOST_TOLD + 1
    assert lines[-1] == "toaster_200: and 2 more settings."
