"""Photographs or a film without cameras: the sentence holds the commands that find them."""

import shlex
from pathlib import Path

import pytest

from ringlight.data.load import load_scene
from ringlight.data.unposed import remedy_without_cameras
from ringlight.errors import SceneError


def commands(sentence: str) -> list[list[str]]:
    """Those that a shell would run, from the first ``mkdir`` on."""
    shown = sentence[sentence.index("mkdir") :].partition("; then")[0]
    return [shlex.split(command) for command in shown.split(" && ")]


@pytest.mark.parametrize("below", ["", "images", "input"])
def test_photographs_without_cameras_get_colmaps_commands(tmp_path: Path, below: str):
    folder = tmp_path / "my photos"
    (folder / below).mkdir(parents=True)
    for index in range(3):
        (folder / below / f"IMG_{index}.JPG").touch()
    with pytest.raises(SceneError, match=r"no cameras found.*3 photographs without cameras") as refusal:
        load_scene(folder)
    made, reconstruct, undistort = commands(str(refusal.value))
    assert reconstruct[:2] == ["colmap", "automatic_reconstructor"]
    assert reconstruct[reconstruct.index("--image_path") + 1] == str(folder / below)
    assert reconstruct[reconstruct.index("--workspace_path") + 1] == made[2]
    assert undistort[:2] == ["colmap", "image_undistorter"]
    assert undistort[undistort.index("--input_path") + 1] == f"{made[2]}/sparse/0"
    trained = shlex.split(str(refusal.value).rpartition("train on ")[2])
    assert trained == [undistort[undistort.index("--output_path") + 1]] == made[3:]
    assert not any(Path(folder_made).is_relative_to(folder / below) for folder_made in made[2:]), (
        "what COLMAP writes is not taken for photographs"
    )


@pytest.mark.parametrize("inside", [False, True])
def test_a_film_is_first_cut_into_photographs(tmp_path: Path, inside: bool):
    film = tmp_path / "the garden.MOV"
    film.touch()
    with pytest.raises(SceneError, match="is a film") as refusal:
        load_scene(tmp_path if inside else film)
    made, cut, *_ = commands(str(refusal.value))
    assert cut[:3] == ["ffmpeg", "-i", str(film)]
    assert str(Path(cut[-1]).parent) == made[-1]


def test_a_folder_of_neither_has_no_such_remedy(tmp_path: Path):
    (tmp_path / "notes.txt").touch()
    assert remedy_without_cameras(tmp_path) is None
    assert remedy_without_cameras(tmp_path / "notes.txt") is None
