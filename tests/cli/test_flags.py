"""What a person is told is named as that person named it."""

from ringlight.cli.flags import by_flag, joined, lists_of, near
from ringlight.cli.parse import parse
from ringlight.cli.table import TableArguments


def test_a_setting_is_named_by_the_flag_that_was_given():
    given = ["photos", "3dgs", "--densify.reset-opacity", "3", "--steps=0"]
    assert by_flag("densify.reset_opacity is 3.0; give less", given) == "--densify.reset-opacity is 3.0; give less"
    assert by_flag("steps is 0; give at least 1", given) == "--steps is 0; give at least 1"
    assert by_flag("drop by densify.reset_opacity.", given) == "drop by --densify.reset-opacity."


def test_a_flag_that_is_spelt_with_underscores_is_the_same():
    assert by_flag("sh_rate is -1", ["photos", "3dgs", "--sh_rate", "-1"]) == "--sh-rate is -1"


def test_what_was_not_given_keeps_its_name():
    given = ["photos", "3dgs", "--steps", "7"]
    for sentence in ("sh_rate is -1", "the run has 7 steps", "--steps is 7", "a/steps.txt: no such file", "two-steps"):
        assert by_flag(sentence, given) == sentence


def test_a_path_is_no_setting():
    given = ["steps", "3dgs", "--steps", "7", "--sh-rate=-1", "--out", "out"]
    for sentence in (
        "steps: no cameras",
        "out: holds no model",
        "out is no run folder",
        "a/sh_rate: no cameras",
        "sh_rate/x: no",
        "/x/sh_rate/y",
    ):
        assert by_flag(sentence, given) == sentence


def test_the_flag_that_was_meant():
    flags = {"--steps", "--stop", "--light.ring.rank", "--density-rank"}
    assert near("--step", flags) == "--steps"
    assert near("--rank", flags) == "--light.ring.rank"
    assert near("--rank", flags - {"--light.ring.rank"}) == "--density-rank"
    assert near("--stesp", flags) == "--steps"
    assert near("--rank", {"--masks"}, flags) == "--light.ring.rank", "a name before a likeness"
    assert near("--opacty", {"--format"}, {"--opacity"}) == "--opacity", "the more alike"
    assert near("--colour", flags) is None


def test_values_of_a_flag_that_is_given_twice_are_all_kept():
    lists = lists_of(TableArguments)
    assert {"--set", "--lpips"} <= lists
    line = ["photos", "--set", "a.x=1", "b.y=2", "--steps", "3", "--set", "c.z=-1", "--steps", "4", "--set=d.w=5"]
    together = ["photos", "--set", "a.x=1", "b.y=2", "c.z=-1", "d.w=5", "--steps", "3", "--steps", "4"]
    assert joined(line, lists) == together
    assert parse(TableArguments, "table", [*line, "--methods", "3dgs"]).set == ("a.x=1", "b.y=2", "c.z=-1", "d.w=5")
    assert joined(["--set=a.x=1", "--set=b.y=2"], lists) == ["--set", "a.x=1", "b.y=2"]
    assert joined(["--lpips", "--", "photos"], lists) == ["--lpips", "--", "photos"]


def test_a_line_without_such_flags_stays_as_it_is():
    line = ["photos", "--set", "a.x=1", "--lpips", "--out", "--steps=3", "-", "--", "--set", "--set"]
    assert joined(line[:-3], {"--set", "--lpips"}) == line[:-3]
    assert joined([], {"--set"}) == []
