"""Which runs a table has: methods with settings by name, folders, and what is plain JSON on the way."""

import json
from pathlib import Path

import pytest

from ringlight.data.options import SceneOptions
from ringlight.errors import RecipeError
from ringlight.methods.table import METHODS
from ringlight.runs.expected_time import core_seconds
from ringlight.runs.method_runs import expected, methods_named, order_of, plan
from ringlight.runs.planned import PlannedRun


def test_settings_are_a_methods_own_and_columns_may_have_names() -> None:
    settings = ("eager.densify.threshold=1e-4", "eager.loss.ssim-weight=0", "3dgs.antialiased=true")
    plain, eager, other = methods_named(["3dgs", "eager=3dgs", "ringlight"], settings, 70)
    assert (plain.name, plain.preset, plain.recipe.steps) == ("3dgs", "3dgs", 70)
    assert eager.recipe.densify.threshold == 1e-4
    assert eager.recipe.loss.ssim_weight == 0
    assert plain.recipe.densify == METHODS["3dgs"].densify
    assert plain.recipe.antialiased is True
    assert other.recipe.steps == 70


@pytest.mark.parametrize(
    ("names", "settings", "words"),
    [
        (["3dsg"], [], "perhaps you meant '3dgs'"),
        (["a=ringlight-miror"], [], "perhaps you meant 'ringlight-mirror'"),
        (["3dgs", "3dgs"], [], "twice"),
        (["../3dgs=3dgs"], [], "a name is that of a folder"),
        (["3dgs"], ["3dgs.densify.treshold=1"], "perhaps you meant 'threshold'"),
        (["3dgs"], ["ringlight.steps=1"], "not among --methods"),
        (["3dgs"], ["3dgs.steps"], "is no METHOD.key=value"),
        (["3dgs"], ["3dgs.densify.every=often"], "no value that 3dgs takes"),
        (["3dgs"], ["3dgs.average=7"], "--set 3dgs.average: average is 7; give a share"),
        (["3dgs"], ["3dgs.densify.max-gaussians=-3"], "max_gaussians is -3; give at least 0"),
        (["3dgs"], ["3dgs.steps.more=1"], "no setting 'more'"),
        (["a=3dgs"], ["a.steps=0"], "--set a.steps is 0; give at least 1"),
        (["a=tensorf"], ["a.steps=-5"], "--set a.steps is -5; give at least 1"),
        (["a=3dgs"], ["a.densify.threshold=" + "9" * 400], "no value that 3dgs takes"),
        (["a=3dgs"], ["a.densify.threshold=" + "[" * 20_000], "no value that 3dgs takes"),
        (["a=3dgs"], ["a.densify.threshold=" + "[" * 800 + "]" * 800], "no value that 3dgs takes"),
    ],
)
def test_what_is_wrong_is_a_sentence(names: list[str], settings: list[str], words: str) -> None:
    with pytest.raises(RecipeError) as refused:
        methods_named(names, settings, None)
    assert words in str(refused.value)
    assert len(str(refused.value)) < 200


@pytest.mark.parametrize("preset", METHODS)
def test_a_run_is_plain_json_and_back(preset: str, tmp_path: Path) -> None:
    options = SceneOptions(downscale=2, holdout="a.png,b.png")
    run = PlannedRun(tmp_path, preset, METHODS[preset], 3, tmp_path / "run", options)
    order = json.loads(json.dumps(order_of(run, 2, "auto", ("alex",))))
    assert PlannedRun.from_plain(order["run"]) == run


def test_a_run_is_read_alike_in_another_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As by a worker of a cluster, which was started elsewhere."""
    (tmp_path / "list.txt").write_text("a.png\nb.png\n")
    (tmp_path / "scene" / "cut").mkdir(parents=True)
    monkeypatch.chdir(tmp_path)
    options = SceneOptions(holdout="list.txt", masks="cut", photos="photographs")
    run = PlannedRun(Path("scene"), "3dgs", METHODS["3dgs"], 0, Path("out"), options)
    told = order_of(run, 1, "auto", ())["run"]["options"]
    assert told["holdout"].split() == ["a.png", "b.png"]
    assert told["masks"] == "cut", "the scene's own"
    assert told["photos"] == str(tmp_path / "photographs")


def test_each_pair_and_seed_has_its_folder_and_an_estimate(tmp_path: Path) -> None:
    methods = methods_named(["3dgs", "ringlight"], [], 100)
    runs = plan([Path("toaster"), Path("carpaint")], methods, (0, 5), tmp_path, SceneOptions())
    assert len(runs) == 8
    assert runs["carpaint", "3dgs", 5].run.folder == tmp_path / "carpaint" / "3dgs" / "seed-5"
    assert {surveyed.state for surveyed in runs.values()} == {"to do"}
    seconds, told = core_seconds(expected(runs))
    assert seconds == pytest.approx(8 * 100 * 0.03)
    assert not told
