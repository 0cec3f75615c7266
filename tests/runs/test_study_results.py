"""What a study leaves behind where runs are missing: no mean over fewer scenes than were asked for."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from samples import sample_report

from ringlight.data.options import SceneOptions
from ringlight.measure.study_table import ALL_SCENES
from ringlight.methods.table import METHODS
from ringlight.methods.variant import Variant
from ringlight.runs.finish import write_report
from ringlight.runs.study import StudyRun
from ringlight.runs.study_results import study_table, write_results

VARIANTS = tuple(Variant(name, "3dgs", replace(METHODS["3dgs"], steps=5), name) for name in ("full", "half", "none"))


@pytest.fixture
def runs(tmp_path: Path) -> list[StudyRun]:
    """Of three scenes; those of scene c, and one of half on b, are missing."""
    made = [
        StudyRun(Path(scene), variant, seed, tmp_path / scene / variant.name / f"seed-{seed}", SceneOptions())
        for scene in "abc"
        for variant in VARIANTS
        for seed in (0, 1)
    ]
    for run in made:
        if run.scene_name == "c" or run.variant.name == "none" or run.name == "b/half/seed-1":
            continue
        run.folder.mkdir(parents=True)
        write_report(run.folder / "report.json", sample_report(scene=run.scene_name, iterations=5))
    return made


def test_there_is_no_mean_without_a_scene_that_was_asked_for(runs: list[StudyRun], tmp_path: Path) -> None:
    table = study_table(VARIANTS, runs)
    assert {row.scene for row in table.rows} == {"a", "b"}
    expected = (
        "Over all scenes there is no mean of full, for want of 2 runs of c.",
        "Over all scenes there is no mean of half, for want of 1 run of b, 2 runs of c.",
    )
    assert table.notes == expected
    write_results(tmp_path, "ablation", "3dgs", runs, table)
    assert all(note in (tmp_path / "ablation.md").read_text() for note in expected)
    assert json.loads((tmp_path / "ablation.json").read_text())["notes"] == list(expected)


def test_of_scenes_that_are_all_there_nothing_is_noted(runs: list[StudyRun]) -> None:
    there = [run for run in runs if run.scene_name != "c" and run.variant.name == "full"]
    table = study_table(VARIANTS, there)
    assert ALL_SCENES in {row.scene for row in table.rows}
    assert table.notes == ()
