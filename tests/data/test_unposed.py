"""Photographs or a film without cameras: the sentence holds the commands that find them."""

import shlex
from pathlib import Path

import pytest

from ringlight.data.load import load_scene
from ringlight.data.unposed import remedy_without_cameras
from ringlight.errors import SceneError


def command_and_scene(sentence: str) -> tuple[list[str], list[str]]:
    """The command that finds cameras, as a shell would part it, and the scene that is trained on then."""
    command, _, rest = sentence.partition("ringlight poses ")[2].partition("; then train on ")
    return shlex.split(command), shlex.split(rest.partition(", or give train --poses auto")[0])


@pytest.mark.parametrize("below", ["", "images", "input"])
def test_photographs_without_cameras_get_the_command(tmp_path: Path, below: str):
    folder = tmp_path / "my photos"
    (folder / below).mkdir(parents=True)
    for index in range(3):
        (folder / below / f"IMG_{index}.JPG").touch()
    with pytest.raises(SceneError, match=r"no cameras found.*3 photographs without cameras") as refusal:
        load_scene(folder)
    (photographs, scene), trained = command_and_scene(str(refusal.value))
    assert photographs == str(folder / below)
    assert trained == [scene]
    assert not Path(scene).is_relative_to(folder / below), "what is written is not taken for photographs"


@pytest.mark.parametrize("inside", [False, True])
def test_a_film_gets_the_command(tmp_path: Path, inside: bool):
    film = tmp_path / "the garden.MOV"
    film.touch()
    with pytest.raises(SceneError, match="is a film") as refusal:
        load_scene(tmp_path if inside else film)
    assert command_and_scene(str(refusal.value)) == (
        [str(film), str(tmp_path / "the garden-scene")],
        [str(tmp_path / "the garden-scene")],
    )


def test_a_folder_of_neither_has_no_such_remedy(tmp_path: Path):
    (tmp_path / "notes.txt").touch()
    assert remedy_without_cameras(tmp_path) is None
    assert remedy_without_cameras(tmp_path / "notes.txt") is None
