"""Photographs that were undistorted once lie beside the run; whatever happens to these files, pixels stay the same."""

import copy
import errno
import pickle
import shutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scene_folders import FOCAL, HEIGHT, WIDTH, write_colmap, write_image

from ringlight.core.scene import Scene
from ringlight.data import undistort
from ringlight.data.images import Photograph
from ringlight.data.load import load_scene
from ringlight.data.options import SceneOptions
from ringlight.files.atomic import BEGUN, HALF_DONE
from ringlight.runs import undistorted
from ringlight.runs.opened import open_model, scene_of
from ringlight.runs.resume import resume_run
from ringlight.runs.session import Session
from ringlight.runs.start import start_run
from ringlight.runs.undistorted import UndistortedFolder
from small_recipes import small

LENS = ("OPENCV", 4, (FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2, -0.21, 0.06, 0.002, -0.003))


@pytest.fixture(autouse=True)
def any_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tests pass where a disk is nearly full."""
    monkeypatch.setattr(undistorted, "ROOM_LEFT", 0)


@pytest.fixture
def resamplings(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Gets an entry whenever pixels are resampled."""
    counted, resampled = [], undistort.resampled
    monkeypatch.setattr(undistort, "resampled", lambda *given: counted.append(1) or resampled(*given))
    return counted


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    return write_colmap(tmp_path / "scene", camera=LENS)


def pixels(scene: Scene) -> list[np.ndarray]:
    return [view.load() for view in (*scene.train, *scene.test)]


def same(some: list[np.ndarray], others: list[np.ndarray]) -> bool:
    return all(np.array_equal(one, other) for one, other in zip(some, others, strict=True))


def files(folder: Path) -> list[Path]:
    return sorted(folder.glob("*")) if folder.is_dir() else []


def test_the_second_reading_resamples_nothing(tmp_path: Path, scene: Path, resamplings: list[int]):
    without = pixels(load_scene(scene))
    first = pixels(load_scene(scene, keeper=UndistortedFolder(tmp_path / "kept")))
    assert len(resamplings) == 2 * 9
    again = pixels(load_scene(scene, keeper=UndistortedFolder(tmp_path / "kept")))
    assert len(resamplings) == 2 * 9
    assert same(without, first)
    assert same(without, again)
    assert len(files(tmp_path / "kept")) == 9


@pytest.mark.parametrize("changed", ["photograph", "lens", "size"])
def test_what_has_changed_is_made_anew_in_its_place(tmp_path: Path, scene: Path, resamplings: list[int], changed: str):
    pixels(load_scene(scene, keeper=UndistortedFolder(tmp_path / "kept")))
    kept, options = files(tmp_path / "kept"), SceneOptions()
    resamplings.clear()
    if changed == "photograph":
        write_image(next((scene / "images").rglob("*.png")), seed=77)
    elif changed == "lens":
        write_colmap(scene, camera=(*LENS[:2], (*LENS[2][:4], -0.2, *LENS[2][5:])))
    else:
        options = SceneOptions(max_width=9)
    again = pixels(load_scene(scene, options, UndistortedFolder(tmp_path / "kept")))
    assert len(resamplings) == (1 if changed == "photograph" else 9)
    assert same(again, pixels(load_scene(scene, options)))
    assert files(tmp_path / "kept") == kept


@pytest.fixture(scope="module")
def one_kept(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, bytes, np.ndarray]:
    folder = tmp_path_factory.mktemp("one")
    made = np.random.default_rng(0).integers(0, 256, (5, 7, 4), dtype=np.uint8)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(undistorted, "ROOM_LEFT", 0)
        UndistortedFolder(folder).keep("a", "of this", made)
    [file] = files(folder)
    return folder, file.read_bytes(), made


def found(kept: tuple[Path, bytes, np.ndarray], content: bytes) -> np.ndarray | None:
    [file] = files(kept[0])
    file.write_bytes(content)
    return UndistortedFolder(kept[0]).find("a", "of this")


def test_a_whole_file_is_found(one_kept: tuple[Path, bytes, np.ndarray]):
    read = found(one_kept, one_kept[1])
    assert read is not None
    assert np.array_equal(read, one_kept[2])
    assert UndistortedFolder(one_kept[0]).find("a", "of that") is None
    assert UndistortedFolder(one_kept[0]).find("b", "of this") is None


def test_a_flipped_bit_is_noticed_wherever_it_is(one_kept: tuple[Path, bytes, np.ndarray]):
    for place in range(len(one_kept[1])):
        content = bytearray(one_kept[1])
        content[place] ^= 1 << place % 8
        assert found(one_kept, bytes(content)) is None


@given(cut=st.integers(0, 400), more=st.binary(max_size=40), flips=st.lists(st.integers(0, 3199), max_size=4))
def test_damage_is_never_an_error_nor_other_pixels(
    one_kept: tuple[Path, bytes, np.ndarray], cut: int, more: bytes, flips: list[int]
):
    content = bytearray(one_kept[1][:cut] + more)
    for flip in flips:
        if flip // 8 < len(content):
            content[flip // 8] ^= 1 << flip % 8
    read = found(one_kept, bytes(content))
    assert read is None or np.array_equal(read, one_kept[2])


@settings(max_examples=20)
@given(st.integers(0, 399), st.booleans())
def test_damaged_files_are_made_anew(tmp_path_factory: pytest.TempPathFactory, place: int, is_cut: bool):
    folder = tmp_path_factory.mktemp("damaged")
    scene = write_colmap(folder / "scene", camera=LENS)
    made = pixels(load_scene(scene, keeper=UndistortedFolder(folder / "kept")))
    whole = {file: file.read_bytes() for file in files(folder / "kept")}
    for file, before in whole.items():
        content = bytearray(before)
        content[place % len(content)] ^= 255
        file.write_bytes(content[: place % len(content)] if is_cut else content)
    keeper = UndistortedFolder(folder / "kept")
    assert same(made, pixels(load_scene(scene, keeper=keeper)))
    assert {file: file.read_bytes() for file in files(folder / "kept")} == whole


def test_deleting_the_folder_is_harmless(tmp_path: Path, scene: Path):
    keeper = UndistortedFolder(tmp_path / "kept")
    read = load_scene(scene, SceneOptions(photo_memory=0.0), keeper)
    made = pixels(read)
    shutil.rmtree(tmp_path / "kept")
    assert same(made, pixels(read))


@pytest.mark.parametrize("trouble", ["a file in its place", "no run", "a full disk", "a nearly full disk"])
def test_what_cannot_be_written_is_not_kept(tmp_path: Path, scene: Path, monkeypatch: pytest.MonkeyPatch, trouble: str):
    run = tmp_path / "run"
    if trouble != "no run":
        run.mkdir()
    if trouble == "a file in its place":
        (run / "undistorted").write_text("mine")
    elif trouble == "a full disk":

        def full(one: Path, other: Path) -> None:
            raise OSError(errno.ENOSPC, "No space left on device")

        monkeypatch.setattr(Path, "replace", full)
    elif trouble == "a nearly full disk":
        monkeypatch.setattr(undistorted, "ROOM_LEFT", 1 << 62)
    made = pixels(load_scene(scene, keeper=UndistortedFolder(run / "undistorted")))
    assert same(made, pixels(load_scene(scene)))
    assert run.is_dir() == (trouble != "no run")
    assert not files(run / "undistorted")


def test_a_process_fills_a_quarter_of_what_is_free(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    made = np.zeros((10, 10, 3), np.uint8)
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: SimpleNamespace(free=4 * 3 * made.nbytes))
    keeper = UndistortedFolder(tmp_path / "kept")
    for name in "abcde":
        keeper.keep(name, "of this", made)
    assert [keeper.find(name, "of this") is not None for name in "abcde"] == [True] * 3 + [False] * 2


def test_a_folder_that_was_deleted_is_not_made_again(tmp_path: Path):
    keeper = UndistortedFolder(tmp_path / "kept")
    keeper.keep("a", "of this", np.zeros((2, 2, 3), np.uint8))
    shutil.rmtree(tmp_path / "kept")
    keeper.keep("b", "of this", np.zeros((2, 2, 3), np.uint8))
    assert not (tmp_path / "kept").exists()


def test_a_folder_that_comes_later_gets_what_is_in_memory(tmp_path: Path, scene: Path, resamplings: list[int]):
    keeper = UndistortedFolder()
    read = load_scene(scene, keeper=keeper)
    made = pixels(read)
    keeper.begin(tmp_path / "kept")
    keeper.wait()
    assert len(files(tmp_path / "kept")) == 9
    assert same(made, pixels(load_scene(scene, keeper=UndistortedFolder(tmp_path / "kept"))))
    assert len(resamplings) == 9


def test_what_is_not_in_memory_any_more_is_kept_at_its_next_use(tmp_path: Path, scene: Path, resamplings: list[int]):
    keeper = UndistortedFolder()
    read = load_scene(scene, SceneOptions(photo_memory=0.0), keeper)
    for view in read.train:
        view.load()
    keeper.begin(tmp_path / "kept")
    keeper.wait()
    assert not files(tmp_path / "kept")
    assert same(pixels(read), pixels(read))
    assert len(resamplings) == len(read.train) + 9


def test_two_at_once_do_not_disturb_each_other(tmp_path: Path, scene: Path):
    made = pixels(load_scene(scene))
    (tmp_path / "kept").mkdir()
    scenes = [load_scene(scene, SceneOptions(photo_memory=0.0), UndistortedFolder(tmp_path / "kept")) for _ in range(4)]
    with ThreadPoolExecutor(4) as threads:
        assert all(same(made, read) for read in threads.map(pixels, 3 * scenes))
    assert len(files(tmp_path / "kept")) == 9


def test_it_goes_to_other_processes(tmp_path: Path, scene: Path):
    waiting = UndistortedFolder()
    read = load_scene(scene, keeper=waiting)
    made = read.train[0].load()
    for copied in (copy.deepcopy(read.train[0].load), pickle.loads(pickle.dumps(read.train[0].load))):
        assert np.array_equal(copied(), made)


def trained(run: Path, scene: Path) -> Session:
    """A session of two steps that has decoded its training views, and written what was to be written."""
    session = start_run(run, scene, "3dgs", replace(small("3dgs", steps=2), steps=2), SceneOptions(), 0, "cpu")
    session.photographs.wait()
    session.save()
    session.lock.release()
    photograph = session.scene.train[0].load
    assert isinstance(photograph, Photograph)
    assert isinstance(photograph.keeper, UndistortedFolder)
    photograph.keeper.wait()
    return session


def test_a_run_keeps_them_and_later_commands_read_them(tmp_path: Path, scene: Path, resamplings: list[int]):
    run = tmp_path / "run"
    session = trained(run, scene)
    assert len(files(run / "undistorted")) == len(session.scene.train) == 7
    made = pixels(session.scene)
    assert len(resamplings) == 9
    kept = files(run / "undistorted")
    assert len(kept) == 9, "test views at their first use"

    left = session.folder.undistorted / f"{BEGUN}0123456789ab{HALF_DONE}"
    left.write_bytes(b"of a killed writer")
    resumed = resume_run(run)
    resumed.lock.release()
    assert same(made, pixels(resumed.scene))
    assert files(session.folder.undistorted) == kept

    opened = open_model(run)
    assert same(made, pixels(scene_of(opened, None, SceneOptions())))
    assert len(resamplings) == 9
    assert "undistorted" not in (run / "recipe.json").read_text()


def test_without_a_run_nothing_is_written(tmp_path: Path, scene: Path):
    run = tmp_path / "run"
    session = trained(run, scene)
    (tmp_path / "alone").mkdir()
    model = Path(shutil.copyfile(session.folder.model, tmp_path / "alone" / "model.safetensors"))
    pixels(scene_of(open_model(model), None, SceneOptions()))
    shutil.rmtree(run / "undistorted")
    pixels(scene_of(open_model(run), scene, SceneOptions()))
    assert files(tmp_path / "alone") == [model]
    assert not (run / "undistorted").exists()
    assert not list(scene.rglob("*.safetensors"))


def test_a_run_on_pinholes_has_no_such_folder(tmp_path: Path):
    session = trained(tmp_path / "run", write_colmap(tmp_path / "scene"))
    pixels(session.scene)
    assert not session.folder.undistorted.exists()


def test_what_is_read_holds_no_more_memory_than_its_pixels(tmp_path: Path):
    made = np.zeros((4, 5, 3), np.uint8)
    UndistortedFolder(tmp_path / "kept").keep("a", "of this", made)
    read = UndistortedFolder(tmp_path / "kept").find("a", "of this")
    assert read is not None
    assert torch.from_numpy(read).untyped_storage().nbytes() == made.nbytes
