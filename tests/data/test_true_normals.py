"""True normals are read as the format says; any other file is one sentence, and takes no memory and runs no code."""

import io
import struct
import tracemalloc
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fuzz import fuzzed
from ringlight.core.scene import Scene
from ringlight.data.true_normals import read_true_normals, refuse_turned_away, views_of
from ringlight.errors import SceneError
from tiny_scene import tiny_scene
from true_normals_file import arrays_of, ball_normals, stored, write_truth

SIZE = 16


@pytest.fixture(scope="module")
def scene() -> Scene:
    return tiny_scene(views=4, size=SIZE)


def read(path: Path, scene: Scene) -> list[np.ndarray]:
    """As the command does."""
    truth = read_true_normals(path)
    views = views_of(truth, scene)
    found = list(truth.views())
    for view, normals in zip(views, found, strict=True):
        refuse_turned_away(normals, view, truth)
    return found


def refused(path: Path, scene: Scene) -> str:
    with pytest.raises(SceneError) as caught:
        read(path, scene)
    sentence = str(caught.value)
    assert "\n" not in sentence
    assert str(path) in sentence
    assert ";" in sentence, "no remedy"
    return sentence


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_what_was_saved_is_read(save: Callable, scene: Scene, tmp_path: Path) -> None:
    path = tmp_path / "truth.npz"
    save(path, depths=np.zeros((2, 1), np.float16), **arrays_of(scene))
    for found, view in zip(read(path, scene), scene.test, strict=True):
        assert np.abs(found - ball_normals(view.camera)).max() < 1e-4
        assert found.any()


@pytest.mark.parametrize("change", [lambda a: a.astype(">i2"), lambda a: a])
def test_either_order_of_bytes_is_read(change: Callable, scene: Scene, tmp_path: Path) -> None:
    normals = arrays_of(scene)["normals"]
    path = write_truth(tmp_path / "truth.npz", scene, normals=change(normals), names=np.array(["000", "001"], ">U3"))
    assert (np.stack(read(path, scene)) == normals / 32767).all()


@pytest.mark.parametrize("form", ["{0}", "test/{0}", "{0}.png", "test/{0}.png"])
def test_views_go_by_their_names_in_the_file_s_order(form: str, scene: Scene, tmp_path: Path) -> None:
    path = write_truth(tmp_path / "truth.npz", scene, names=np.array([form.format("001"), form.format("000")]))
    assert [view.name for view in views_of(read_true_normals(path), scene)] == ["test/001.png", "test/000.png"]


def test_a_part_of_the_views_is_enough(scene: Scene, tmp_path: Path) -> None:
    arrays = arrays_of(scene)
    path = write_truth(tmp_path / "truth.npz", scene, normals=arrays["normals"][1:], names=arrays["names"][1:])
    assert len(read(path, scene)) == 1


def test_files_that_do_not_fit_the_scene_are_refused(scene: Scene, tmp_path: Path) -> None:
    path = write_truth(tmp_path / "truth.npz", scene)
    assert "16x16 normals, and the camera 18x18" in refused(path, tiny_scene(views=4, size=SIZE + 2))
    assert "no test views" in refused_alone(path, replace(scene, test=()))
    alike = tuple(replace(view, name=f"{place}/000.jpg") for place, view in zip("ab", scene.test, strict=True))
    assert "'a/000.jpg', 'b/000.jpg'" in refused(path, replace(scene, test=alike))
    path = write_truth(path, scene, names=np.array(["000", "7\x1b[2K"]))
    assert r"no test view '7\x1b[2K'" in refused(path, scene)


def refused_alone(path: Path, scene: Scene) -> str:
    with pytest.raises(SceneError) as caught:
        read(path, scene)
    return str(caught.value)


def _with(**others: object) -> Callable[[Path, Scene], object]:
    return lambda path, scene: write_truth(path, scene, **others)


def _bytes(content: bytes) -> Callable[[Path, Scene], object]:
    return lambda path, scene: path.write_bytes(content)


def _npy(head: str, data: bytes = b"", version: int = 1) -> bytes:
    length = struct.pack("<H" if version == 1 else "<I", len(head))
    return b"\x93NUMPY" + bytes([version, 0]) + length + head.encode() + data


def _archive(normals: bytes, kind: int = zipfile.ZIP_STORED) -> Callable[[Path, Scene], object]:
    def write(path: Path, scene: Scene) -> None:
        names = io.BytesIO()
        np.save(names, arrays_of(scene)["names"])
        with zipfile.ZipFile(path, "w", kind) as archive:
            archive.writestr("normals.npy", normals)
            archive.writestr("names.npy", names.getvalue())

    return write


def _locked(path: Path, scene: Scene) -> None:
    content = write_truth(path, scene).read_bytes()
    for mark, at in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):  # the bit that says that a member is encrypted
        place = content.index(mark) + at
        content = content[:place] + bytes([content[place] | 1]) + content[place + 1 :]
    path.write_bytes(content)


def _turned_round(path: Path, scene: Scene) -> None:
    write_truth(path, scene, normals=-arrays_of(scene)["normals"])


def _of_other_lengths(path: Path, scene: Scene) -> None:
    write_truth(path, scene, normals=arrays_of(scene)["normals"] // 2)


HEAD = "{{'descr': {0}, 'fortran_order': False, 'shape': {1}, }}"
HUGE = "(1000000, 1000000, 1000000, 3)"

HOSTILE: dict[str, tuple[Callable[[Path, Scene], object], str]] = {
    "nothing": (_bytes(b""), "no NPZ file"),
    "text": (_bytes(b"normals"), "no NPZ file"),
    "an array alone": (_bytes(_npy(HEAD.format("'<i2'", "(2,)"), b"abcd")), "no NPZ file"),
    "no normals": (_with(normals=None), "no array 'normals'"),
    "no names": (_with(names=None), "no array 'names'"),
    "objects": (_with(names=np.array([print, 2], object)), "'|O'"),
    "normals as objects": (_with(normals=np.array([print], object)), "'|O'"),
    "a record": (_with(normals=np.zeros((2, SIZE, SIZE, 3), [("x", "<i2")])), "a type that is not taken"),
    "floats": (_with(normals=np.zeros((2, SIZE, SIZE, 3), np.float32)), "float32 [2, 16, 16, 3], not int16"),
    "bytes": (_with(normals=np.zeros((2, SIZE, SIZE, 3), np.uint8)), "'|u1'"),
    "two channels": (_with(normals=np.zeros((2, SIZE, SIZE, 2), np.int16)), "[2, 16, 16, 2]"),
    "one view without its axis": (_with(normals=np.zeros((SIZE, SIZE, 3), np.int16)), "[16, 16, 3]"),
    "Fortran's order": (_with(normals=np.asfortranarray(np.ones((2, SIZE, SIZE, 3), np.int16))), "ascontiguousarray"),
    "too few names": (_with(names=np.array(["000"])), "texts [1], not 2 texts"),
    "names that are numbers": (_with(names=np.array([0, 1])), "int64 [2], not 2 texts"),
    "one name twice": (_with(names=np.array(["000", "000"])), "2 views are called '000'"),
    "no view": (_with(normals=np.zeros((0, 4, 4, 3), np.int16), names=np.zeros(0, "U3")), "no view"),
    "long names": (_with(normals=np.zeros((999, 1, 1, 3), np.int16), names=np.zeros(999, "U5000")), "its names take"),
    "no characters": (_with(names=np.frombuffer(b"\xff" * 24, "<U3")), "damaged"),
    "turned round": (_turned_round, "point away from the camera"),
    "of other lengths": (_of_other_lengths, "another length than 1"),
    "a false size": (_archive(_npy(HEAD.format("'<i2'", HUGE), b"ab")), "where its head says 6000000000000000"),
    "a negative size": (_archive(_npy(HEAD.format("'<i2'", "(2, -1, 3, 3)"))), "cannot be read"),
    "sides that are truths": (_archive(_npy(HEAD.format("'<i2'", "(2, True, 3, 3)"))), "cannot be read"),
    "a head of code": (_archive(_npy("__import__('os').getcwd()")), "cannot be read"),
    "a deep head": (_archive(_npy("(" * 3000)), "cannot be read"),
    "a long head": (_archive(_npy(" " * 1_000_000, version=2)), "has 1000000 bytes"),
    "a head of more": (_archive(_npy("{'descr': '<i2', 'fortran_order': False, 'shape': (), 'x': 1}")), "cannot be"),
    "a version to come": (_archive(_npy("{}", version=9)), "no array of NumPy's"),
    "another compression": (_archive(_npy("{}"), zipfile.ZIP_BZIP2), "compressed in another way"),
    "a lock": (_locked, "damaged"),
}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_files_are_one_sentence(name: str, scene: Scene, tmp_path: Path) -> None:
    write, said = HOSTILE[name]
    path = tmp_path / "truth.npz"
    write(path, scene)
    assert said in refused(path, scene)


def test_a_missing_file_and_a_folder_are_refused(scene: Scene, tmp_path: Path) -> None:
    assert "No such file" in refused(tmp_path / "none.npz", scene)
    assert "directory" in refused(tmp_path, scene)


def test_pickled_objects_are_not_loaded(scene: Scene, tmp_path: Path) -> None:
    class Bait:
        def __reduce__(self) -> tuple:
            return (Path.touch, (tmp_path / "taken",))

    for name in ("normals", "names"):
        path = write_truth(tmp_path / "truth.npz", scene, **{name: np.array([Bait(), Bait()], object)})
        refused(path, scene)
    assert not (tmp_path / "taken").exists()


def test_a_file_that_inflates_takes_no_memory(scene: Scene, tmp_path: Path) -> None:
    bomb = np.zeros((2, 2000, 2000, 3), np.int16)
    path = write_truth(tmp_path / "truth.npz", scene, normals=bomb)
    del bomb
    tracemalloc.start()
    assert "2000x2000 normals" in refused(path, scene)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2_000_000, "48 MB inflated"


def test_a_false_checksum_is_noticed(scene: Scene, tmp_path: Path) -> None:
    path = tmp_path / "truth.npz"
    np.savez(path, **arrays_of(scene))
    content, data = path.read_bytes(), arrays_of(scene)["normals"].tobytes()
    place = content.index(data) + data.index(stored(np.zeros(1)).tobytes() * 3)
    path.write_bytes(content[:place] + b"\xff\x7f" + content[place + 2 :])
    assert "CRC" in refused(path, scene)


@fuzzed
@given(data=st.data(), packed=st.booleans())
def test_damage_is_a_sentence_or_does_no_harm(data: st.DataObject, packed: bool, tmp_path_factory) -> None:
    scene = tiny_scene(views=4, size=4)
    path = tmp_path_factory.mktemp("damaged") / "truth.npz"
    (np.savez_compressed if packed else np.savez)(path, **arrays_of(scene))
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.integers(0, len(content) - 1))
        kind = data.draw(st.sampled_from(("set", "cut", "drop", "repeat")))
        if kind == "set":
            content[place] = data.draw(st.integers(0, 255))
        elif kind == "cut":
            del content[max(place, 1) :]
        elif kind == "drop":
            del content[max(place, 1) : place + 8]
        else:
            content[place:place] = content[place : place + 16] * 3
    path.write_bytes(content)
    caught = None
    try:
        assert len(read(path, scene)) == 2
    except SceneError as error:
        caught = str(error)
    if caught is not None:
        assert "\n" not in caught
        assert str(path) in caught
