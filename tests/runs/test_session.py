"""A run's record: the scene is read again as it was read at the start."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from scene_folders import colmap_names, write_colmap, write_mask

from ringlight.data.options import FOUND, UNUSED, SceneOptions
from ringlight.errors import OutputError, RunError
from ringlight.measure import machine
from ringlight.methods.table import METHODS
from ringlight.runs import finish, session
from ringlight.runs.resume import resume_run
from ringlight.runs.start import start_run
from small_recipes import small


@pytest.mark.parametrize("has_masks", [False, True])
def test_masks_that_come_later_are_not_for_a_run_that_began_without(tmp_path: Path, has_masks: bool):
    scene = write_colmap(tmp_path / "scene")
    masks = [scene / "masks" / f"{name}.png" for name in colmap_names(9)]
    if has_masks:
        for mask in masks:
            write_mask(mask)
    recipe = replace(small("3dgs", steps=2), steps=2)
    first = start_run(tmp_path / "run", scene, "3dgs", recipe, SceneOptions(), 0, "cpu")
    assert first.record.options.masks == (FOUND if has_masks else UNUSED)
    first.lock.release()
    for mask in masks:
        write_mask(mask)
    again = resume_run(tmp_path / "run")
    assert again.scene.background == first.scene.background
    assert all(view.has_alpha == has_masks for view in again.scene.train)


def test_undistorted_photographs_make_room_for_a_checkpoint(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    recipe = replace(small("3dgs", steps=2), steps=2)
    run = start_run(tmp_path / "run", write_colmap(tmp_path / "scene"), "3dgs", recipe, SceneOptions(), 0, "cpu")
    kept = run.folder.undistorted
    kept.mkdir()
    (kept / "a.safetensors").write_bytes(b"large")
    write = session.write_checkpoint

    def written_where_there_is_room(*given: Any) -> None:
        if kept.exists():
            raise OutputError("checkpoint.safetensors: cannot be written: your disk quota is used up")
        write(*given)

    monkeypatch.setattr(session, "write_checkpoint", written_where_there_is_room)
    run.save()
    assert run.folder.checkpoint.is_file()
    assert not kept.exists()


def test_a_report_names_the_commit_with_which_its_run_began(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    recipe = replace(small("3dgs", steps=1), steps=1)
    began = machine.source_commit()
    run = start_run(tmp_path / "run", write_colmap(tmp_path / "scene"), "3dgs", recipe, SceneOptions(), 0, "cpu")
    for _ in run.steps():
        pass
    monkeypatch.setattr(machine, "_git", lambda *of: "a later commit")  # the checkout moves on under the run
    later = machine.source_commit()
    if later is None:
        pytest.skip("needs a checkout of ringlight")
    assert finish.measure_session(run, nets=()).commit == began != later


def test_a_folder_that_is_taken_is_refused_before_anything_is_read(tmp_path: Path):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "mine").write_text("")
    with pytest.raises(RunError, match="is not an empty folder; give another one with --out"):
        start_run(tmp_path / "run", tmp_path / "no scene", "3dgs", METHODS["3dgs"], SceneOptions(), 0, "cpu")


def test_a_checkpoint_of_another_run_is_refused_though_its_shapes_fit(tmp_path: Path):
    scene = write_colmap(tmp_path / "scene")
    first, second = (tmp_path / f"run-{seed}" for seed in (0, 1))
    for seed, folder in enumerate((first, second)):
        recipe = replace(small("3dgs", steps=2), steps=2)
        run = start_run(folder, scene, "3dgs", recipe, SceneOptions(), seed, "cpu")
        for _ in run.steps():
            pass
        run.save()
        run.lock.release()
    own = (second / "checkpoint.safetensors").read_bytes()
    (second / "checkpoint.safetensors").write_bytes((first / "checkpoint.safetensors").read_bytes())
    with pytest.raises(RunError, match=r"is of 3dgs with seed 0, and .*recipe.json of 3dgs with seed 1; put"):
        resume_run(second)
    (second / "checkpoint.safetensors").write_bytes(own)
    assert resume_run(second).training.step == 2
