"""What is looked at: named apart from photographs, and large enough to be seen."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from recorded_page import subject_of, trained

from ringlight.core.scene import camera_extent
from ringlight.files.camera_paths import position_of
from ringlight.view.open import named_apart
from ringlight.view.subject import PHOTOGRAPH, SMALLEST_SPREAD, subject
from tiny_scene import tiny_scene


def test_models_are_named_apart_from_each_other_and_from_photographs() -> None:
    paths = [Path("a/run"), Path("b/run"), Path("c") / PHOTOGRAPH]
    named = named_apart(paths)
    assert list(named.values()) == paths
    assert list(named) == ["run", "run 2", f"{PHOTOGRAPH} 2"]


def test_cameras_in_one_place_leave_what_they_see_in_sight(tmp_path: Path) -> None:
    scene = tiny_scene(views=6, size=24)
    alone = replace(scene, train=scene.train[:1], test=())
    about = subject("t", {}, [], alone, tmp_path)
    apart = np.linalg.norm(scene.points.positions.numpy() - position_of(scene.train[0].camera), axis=1)
    assert about.extent >= SMALLEST_SPREAD * np.median(apart)
    model = trained("3dgs", scene, 1).model
    of_model = subject("t", {"run": (model, torch.ones(3))}, [scene.train[0].camera], None, tmp_path)
    assert of_model.extent >= 0.5 * about.extent, "a model's Gaussians say it, too"


def test_cameras_round_a_subject_keep_their_spread(tmp_path: Path) -> None:
    scene = tiny_scene(views=6, size=24)
    about = subject_of(scene, tmp_path)
    assert about.extent == camera_extent([view.camera for view in (*scene.test, *scene.train)])
