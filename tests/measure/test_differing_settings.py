"""A comparison says in which settings its runs differ, if they are of one preset and scene."""

from samples import sample_report

from ringlight.measure.differing_settings import LONGEST, MOST_TOLD, differing_settings
from ringlight.measure.table import ResultsTable


def of_two(first, second):
    return differing_settings([("a", sample_report(settings=first)), ("b", sample_report(settings=second))])


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


def test_other_scenes_methods_presets_and_reports_of_before_say_nothing():
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
    for more, words in ((1, "1 more setting"), (2, "2 more settings")):
        lines = of_two({f"setting{index}": "1" for index in range(MOST_TOLD + more)}, {})
        assert len(lines) == MOST_TOLD + 1
        assert lines[-1] == f"toaster_200: and {words}."


def test_runs_of_other_commits_may_have_other_defaults():
    runs = [(commit, sample_report(settings={}, commit=commit)) for commit in ("one", "two")]
    assert differing_settings(runs) == ("toaster_200: one, two are of different commits, whose defaults may differ.",)


def test_what_strangers_wrote_takes_a_line_and_no_more():
    [line] = of_two({"name\n# a heading": "x" * 1000 + "\n"}, {})
    assert "\n" not in line
    assert len(line) < LONGEST + 100
