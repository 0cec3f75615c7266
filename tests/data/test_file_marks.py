"""Photographs that were exchanged since a run was saved are told by their files."""

from pathlib import Path

import pytest
from scene_folders import colmap_names, write_colmap, write_image, write_mask

from ringlight.data.file_marks import PIECE, UNKNOWN, change_since, mark_of, marks_of
from ringlight.data.load import load_scene
from tiny_scene import tiny_scene


def test_the_same_photographs_have_the_same_marks_wherever_they_lie(tmp_path: Path):
    one, other = (load_scene(write_colmap(tmp_path / name)).train for name in ("one", "other"))
    assert marks_of(one) == marks_of(other)
    assert len(set(marks_of(one).split())) == len(one)
    assert change_since(marks_of(one), marks_of(other), other) == ()


@pytest.mark.parametrize("of_mask", [False, True])
def test_a_photograph_or_mask_that_changed_is_named(tmp_path: Path, of_mask: bool):
    write_colmap(tmp_path)
    names = colmap_names(9)
    for name in names:
        write_mask(tmp_path / "masks" / f"{name}.png")
    before = marks_of(load_scene(tmp_path).train)
    if of_mask:
        write_mask(tmp_path / "masks" / f"{names[3]}.png", kept=False)
    else:
        write_image(tmp_path / "images" / names[3], seed=99)
    now = load_scene(tmp_path).train
    [sentence] = change_since(before, marks_of(now), now)
    assert sentence.startswith(f"1 training photograph ({names[3]}) or its mask changed since the run was saved")


@pytest.mark.parametrize("place", [0, 5 * PIECE, -1])
def test_a_byte_at_the_beginning_in_the_middle_and_at_the_end_counts(tmp_path: Path, place: int):
    file = tmp_path / "a.tif"
    content = bytearray(10 * PIECE)
    file.write_bytes(content)
    before = mark_of(file)
    content[place] ^= 1
    file.write_bytes(content)
    assert mark_of(file) != before
    content[place] ^= 1
    file.write_bytes(content)
    assert mark_of(file) == before
    file.write_bytes(content[:-1])
    assert mark_of(file) != before


def test_what_lies_in_no_file_is_never_said_to_have_changed(tmp_path: Path):
    assert mark_of(tmp_path / "gone") == UNKNOWN
    views = tiny_scene(views=3, size=8).train
    assert marks_of(views) == "- - -"
    for before in ("- - -", "01234567 89abcdef 01234567", "", "1"):
        assert change_since(before, marks_of(views), views) == ()
