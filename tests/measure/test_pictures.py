"""Test pictures on disk: their names, reading back to the bit, and damaged files."""

import pytest
import torch
from hypothesis import assume, given
from hypothesis import strategies as st
from PIL import Image
from samples import picture

from ringlight.errors import RunError
from ringlight.measure.picture_names import RENDERS, picture_name
from ringlight.measure.pictures import PictureFolder, read_picture, same_picture


def save(path, pixels):
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray((pixels * 255).round().byte().numpy()).save(path)


NAMES = st.text(min_size=1) | st.text(alphabet="ab_/%F5.", min_size=1)


@given(NAMES, NAMES)
def test_two_views_never_share_a_file(one, other):
    assume(one.removesuffix(".png") != other.removesuffix(".png"))
    assert picture_name(one) != picture_name(other)


@given(NAMES)
def test_names_stay_inside_their_folder(view):
    assert not set('/\\:*?"<>|') & set(picture_name(view))
    assert picture_name(view) not in (".", "..")


def test_ordinary_names_stay_readable():
    assert picture_name("test/r_12.png") == "test__r_12.png"
    assert picture_name("r_12") == "r_12.png"
    assert picture_name("left/Büste 3.jpg") == "left__Büste 3.jpg.png"


def test_pictures_are_read_to_the_bit_and_only_those_that_exist(tmp_path):
    pixels = picture()
    save(tmp_path / RENDERS / picture_name("a/b"), pixels)
    folder = PictureFolder(tmp_path / RENDERS, ["a/b", "gone"])
    assert list(folder) == ["a/b"]
    assert torch.equal(folder["a/b"], pixels)


def test_the_same_pixels_in_other_bytes_are_the_same_picture(tmp_path):
    one, other, third = (tmp_path / RENDERS / f"{name}.png" for name in "abc")
    save(one, picture())
    Image.open(one).save(other, compress_level=0)
    save(third, picture(seed=1))
    assert one.read_bytes() != other.read_bytes()
    assert same_picture(one, other)
    assert not same_picture(one, third)


def test_a_file_cut_anywhere_is_refused_in_one_sentence_or_complete(tmp_path):
    path = tmp_path / RENDERS / "r.png"
    pixels = picture(6, 7)
    save(path, pixels)
    whole = path.read_bytes()
    refusals = []
    for length in range(len(whole)):
        path.write_bytes(whole[:length])
        try:
            # Only checksums and the closing chunk may be missing.
            assert torch.equal(read_picture(path), pixels)
        except RunError as error:
            refusals.append(str(error))
    assert len(refusals) > len(whole) - 30
    assert all("ringlight eval" in refusal and "\n" not in refusal for refusal in refusals)


def test_another_format_or_a_missing_file_is_refused(tmp_path):
    path = tmp_path / RENDERS / "r.png"
    with pytest.raises(RunError, match="cannot be read as a picture"):
        read_picture(path)
    path.parent.mkdir(parents=True)
    Image.new("RGB", (4, 4)).save(path, format="BMP")
    with pytest.raises(RunError, match="cannot be read as a picture"):
        read_picture(path)
