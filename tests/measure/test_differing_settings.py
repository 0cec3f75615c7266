"""A comparison says in which settings its runs differ, if they are of one method and scene."""

from samples import sample_report

from ringlight.measure.differing_settings import LONGEST, MOST_TOLD, differing_settings
from ringlight.measure.report import GivenSetting
from ringlight.measure.table import ResultsTable

RAYS, HALF = {"rays": GivenSetting("512", "4096")}, {"downscale": GivenSetting("2", "left open")}


def of_two(first, second):
    return differing_settings([("a", sample_report(settings=first)), ("b", sample_report(settings=second))])


def test_values_stand_with_the_runs_that_have_them_and_defaults_with_the_others():
    runs = [
        ("a", sample_report(settings=RAYS)),
        ("b", sample_report(settings=HALF)),
        ("c", sample_report(settings={"densify.max_gaussians": GivenSetting("900", "left open")})),
    ]
    lines = (
        "--rays: 512 in a; 4096, the default, in the others.",
        "--downscale: 2 in b; left open, the default, in the others.",
        "--densify.max-gaussians: 900 in c; left open, the default, in the others.",
    )
    assert differing_settings(runs) == lines
    assert ResultsTable(runs).notes()[:3] == lines
    assert differing_settings(runs[:2])[0] == "--rays: 512 in a; 4096, the default, in b."


def test_what_a_run_has_none_of_is_no_default():
    extended = {"added": GivenSetting("20"), "from": GivenSetting("first")}
    assert of_two(extended, {}) == ("steps that --resume added: 20 in a; none in b.", "--from: first in a; none in b.")


def test_steps_and_seeds_are_told_whatever_the_methods():
    runs = [
        ("a", sample_report(settings={"steps": GivenSetting("900", "30000")}, planned=900)),
        ("b", sample_report(preset="3dgs-paper", seed=1)),
        ("c", sample_report(planned=None, seed=None)),
    ]
    assert differing_settings(runs)[:2] == ("steps: 900 in a; 3,000 in b.", "seeds: 0 in a; 1 in b.")


def test_other_scenes_methods_and_presets_are_not_held_against_each_other():
    first = sample_report(settings=RAYS)
    others = [
        sample_report(settings={}, scene="carpaint"),
        sample_report(settings={}, method="putt"),
        sample_report(settings={}, preset="3dgs-paper"),
        sample_report(settings=RAYS),
    ]
    assert differing_settings([("a", first), *((str(index), other) for index, other in enumerate(others))]) == ()


def test_where_there_are_several_scenes_lines_begin_with_theirs():
    runs = [
        *(("a", sample_report(settings=RAYS)), ("b", sample_report(settings={}))),
        ("c", sample_report(scene="carpaint")),
    ]
    assert differing_settings(runs) == ("toaster_200: --rays: 512 in a; 4096, the default, in b.",)


def test_a_report_without_settings_is_named():
    assert of_two(RAYS, None) == ("b: settings are not known.",)
    assert of_two(None, None) == ()


def test_of_many_the_rest_is_counted():
    for more, words in ((1, "1 more setting"), (2, "2 more settings")):
        lines = of_two({f"setting{index}": GivenSetting("1", "0") for index in range(MOST_TOLD + more)}, {})
        assert len(lines) == MOST_TOLD + 1
        assert lines[-1] == f"and {words}."


def test_runs_of_other_commits_may_have_other_defaults():
    runs = [(commit, sample_report(settings={}, commit=commit)) for commit in ("one", "two")]
    assert differing_settings(runs) == ("one, two are of different commits, whose defaults may differ.",)


def test_what_strangers_wrote_takes_a_line_and_no_more():
    [line] = of_two({"name\n# a heading": GivenSetting("x" * 1000 + "\n", "y" * 1000)}, {})
    assert "\n" not in line
    assert len(line) < 2 * LONGEST + 100
