"""A run's record: the scene is read again as it was read at the start."""

from dataclasses import replace
from pathlib import Path

import pytest
from scene_folders import colmap_names, write_colmap, write_mask

from ringlight.data.options import FOUND, UNUSED, SceneOptions
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
    session = start_run(tmp_path / "run", scene, "3dgs", recipe, SceneOptions(), 0, "cpu")
    assert session.record.options.masks == (FOUND if has_masks else UNUSED)
    session.lock.release()
    for mask in masks:
        write_mask(mask)
    again = resume_run(tmp_path / "run")
    assert again.scene.background == session.scene.background
    assert all(view.has_alpha == has_masks for view in again.scene.train)
