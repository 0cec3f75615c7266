"""The scenes that ship with the program: complete, readable, small, and refused by name when unknown."""

from pathlib import Path

import pytest

from ringlight.data.bundled import BUNDLED, FOLDER, bundled_scene, scene_folder
from ringlight.data.load import load_scene
from ringlight.errors import SceneError

SHIPPED_LIMIT = 6_000_000


@pytest.mark.parametrize("name", BUNDLED)
def test_every_view_decodes(name):
    scene = load_scene(bundled_scene(name))
    assert (len(scene.train), len(scene.test)) == (50, 10)
    assert scene.background == "white"
    for view in (*scene.train, *scene.test):
        image = view.image(scene.background_color)
        assert image.shape == (3, 200, 200)
        assert image.min() >= 0
        assert image.max() <= 1


def test_together_they_stay_small():
    assert sum(path.stat().st_size for path in FOLDER.rglob("*") if path.is_file()) <= SHIPPED_LIMIT


def test_unknown_names_get_the_nearest_or_the_list():
    with pytest.raises(SceneError, match="perhaps you meant 'toaster'"):
        bundled_scene("toster")
    with pytest.raises(SceneError, match="bundled scenes: toaster, carpaint"):
        bundled_scene("garden")


def test_a_folder_that_is_not_there_is_perhaps_a_bundled_scene(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SceneError, match="toster: no such folder; perhaps you meant the bundled scene 'toaster'"):
        scene_folder(Path("toster"))
    for other in ("garden", "photos/toster", "../toster"):
        assert scene_folder(Path(other)) == Path(other)
    assert scene_folder(Path("toaster")) == FOLDER / "toaster"
    Path("toster").mkdir()
    assert scene_folder(Path("toster")) == Path("toster")


def test_a_path_is_not_a_name():
    with pytest.raises(SceneError):
        bundled_scene("../bundled/toaster")
