"""Cameras that COLMAP itself finds: right ones, the same ones again, and a sentence where there are none."""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from textured_room import Shot, save_photographs

from ringlight.data.colmap_binary import read_images
from ringlight.data.load import load_scene
from ringlight.data.poses import world_to_camera_from_quaternion
from ringlight.errors import BackendError, RunError, SceneError
from ringlight.poses import process, run, stages
from ringlight.poses.database import FeatureDatabase
from ringlight.poses.options import PosesOptions
from ringlight.poses.report import PosesReport
from ringlight.poses.run import find_poses

PINHOLE = PosesOptions(lens="simple-pinhole")

PATIENCE = 180
"""Seconds until a process has its first features, on a machine that does other work: it imports COLMAP first."""


def ignore(stage: str, done: int, total: int) -> None:
    """Nobody watches."""


def found(source: Path, out: Path, options: PosesOptions = PINHOLE, threads: int = 1) -> PosesReport:
    return find_poses(source, out, options, threads, ignore)


def model_bytes(scene: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted((scene / "sparse" / "0").iterdir())}


def centers(scene: Path) -> dict[str, np.ndarray]:
    result = {}
    for image in read_images(scene / "sparse" / "0" / "images.bin"):
        matrix = world_to_camera_from_quaternion(image.quaternion, image.translation, "")
        result[image.name] = -matrix[:3, :3].T @ matrix[:3, 3]
    return result


@pytest.fixture(scope="session")
def room(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Shot]]:
    """Eight photographs, one that is damaged, and one of a white wall."""
    folder = tmp_path_factory.mktemp("room") / "my photos"
    taken = save_photographs(folder, 8)
    (folder / "damaged.jpg").write_bytes(b"\xff\xd8 cut")
    Image.new("RGB", (320, 240), (250, 250, 250)).save(folder / "wall.png")
    return folder, taken


@pytest.fixture(scope="session")
def posed(room: tuple[Path, list[Shot]], tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, PosesReport]:
    out = tmp_path_factory.mktemp("posed") / "scene"
    return out, found(room[0], out)


@pytest.mark.slow
def test_all_cameras_are_where_they_were(room: tuple[Path, list[Shot]], posed: tuple[Path, PosesReport]):
    out, report = posed
    assert (report.photographs, report.registered, report.models) == (10, 8, (8,))
    assert report.reprojection_error < 1
    assert len(report.lenses) == 1, "photographs of one size share a lens"
    reasons = {failure.name: failure.reason for failure in report.failed}
    assert "not a readable image" in reasons["damaged.jpg"]
    assert "too little to recognise" in reasons["wall.png"]
    theirs = centers(out)
    ours = np.stack([theirs[f"shot_{index:02d}.png"] for index in range(8)])
    truth = np.stack([shot.center for shot in room[1]])
    # The best similarity, and it must leave the vertical alone: what was found is upright.
    a, b = ours - ours.mean(0), truth - truth.mean(0)
    left, sizes, right = np.linalg.svd(b.T @ a)
    turn = left @ np.diag([1, 1, np.linalg.det(left @ right)]) @ right
    scale = sizes.sum() / (a**2).sum()
    assert np.abs(scale * a @ turn.T - b).max() < 0.03, "of a room of 4"
    assert np.degrees(np.arccos(turn[2, 2])) < 2


@pytest.mark.slow
def test_the_scene_can_be_trained_on_and_the_photographs_are_untouched(
    room: tuple[Path, list[Shot]], posed: tuple[Path, PosesReport]
):
    out, report = posed
    scene = load_scene(out)
    assert scene.format == "colmap"
    assert len(scene.train) + len(scene.test) == 8
    assert Path(report.picture) == out / "cameras.png"
    with Image.open(out / "cameras.png") as picture:
        picture.load()
    assert {path.name for path in room[0].iterdir()} >= {"shot_00.png", "damaged.jpg", "wall.png"}
    assert not (out / "images" / "damaged.jpg").exists()


@pytest.mark.slow
def test_any_number_of_threads_gives_the_same_bits_and_a_complete_run_is_not_done_again(
    room: tuple[Path, list[Shot]], posed: tuple[Path, PosesReport], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    out, report = posed
    found(room[0], tmp_path / "again", threads=3)
    assert model_bytes(tmp_path / "again") == model_bytes(out)

    def never(*words: object) -> None:
        raise AssertionError("COLMAP was asked")

    monkeypatch.setattr(stages, "ask_colmap", never)
    assert found(room[0], out) == report


@pytest.mark.slow
def test_a_killed_run_goes_on_with_what_it_had(
    room: tuple[Path, list[Shot]], posed: tuple[Path, PosesReport], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    out = tmp_path / "scene"
    words = [sys.executable, "-m", "ringlight", "poses", room[0], out, "--lens", "simple-pinhole", "--threads", "1"]
    told = tmp_path / "told.txt"
    with told.open("w") as file:
        process = subprocess.Popen(list(map(str, words)), stderr=file, stdout=file)
    database = FeatureDatabase(out / "poses" / "database.db")
    until = time.monotonic() + PATIENCE
    while time.monotonic() < until and process.poll() is None and not _has_features(database):
        time.sleep(0.01)
    assert process.poll() is None, f"it ended by itself: {told.read_text()}"
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    time.sleep(1)  # the worker notices that it is alone
    had = set(database.features())
    assert had, f"no features after {PATIENCE} seconds: {told.read_text()}"
    assert not (out / "sparse").exists()
    orders = _spied(monkeypatch)
    found(room[0], out)
    sought = {name for order in orders.get("features", []) for group in order["groups"] for name in group["names"]}
    assert not had & sought
    assert {path.name for path in (out / "images").iterdir()} >= had
    assert model_bytes(out) == model_bytes(posed[0])


def _has_features(database: FeatureDatabase) -> bool:
    try:
        return bool(database.features())
    except RunError:  # its tables are just being made
        return False


def _spied(monkeypatch: pytest.MonkeyPatch) -> dict[str, list[Any]]:
    """What COLMAP is asked from now on, by task."""
    orders: dict[str, list[Any]] = {}
    ask = stages.ask_colmap

    def spy(task: str, order: dict[str, Any], *rest: Any) -> Any:
        orders.setdefault(task, []).append(order)
        return ask(task, order, *rest)

    monkeypatch.setattr(stages, "ask_colmap", spy)
    return orders


@pytest.mark.slow
def test_a_run_that_failed_while_mapping_compares_no_pair_again(
    room: tuple[Path, list[Shot]], posed: tuple[Path, PosesReport], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    out = tmp_path / "scene"
    shutil.copytree(posed[0], out)
    shutil.rmtree(out / "sparse")
    record = (out / "poses.json").read_text()
    (out / "poses.json").write_text(record.partition('"report"')[0] + '"report": null}')
    orders = _spied(monkeypatch)
    found(room[0], out)
    assert set(orders) == {"mapping"}
    assert model_bytes(out) == model_bytes(posed[0])


@pytest.mark.slow
def test_photographs_of_two_rooms_are_two_models(tmp_path: Path):
    save_photographs(tmp_path / "both", 6, seed=0, prefix="a")
    save_photographs(tmp_path / "both", 5, seed=1, prefix="b")
    report = found(tmp_path / "both", tmp_path / "scene")
    assert report.models == (6, 5)
    assert {failure.name[0] for failure in report.failed} == {"b"}
    assert "another model, of 5 photographs" in report.failed[0].reason
    assert "2 models" in "\n".join(report.lines())


@pytest.mark.slow
def test_photographs_that_do_not_overlap_are_one_sentence(tmp_path: Path):
    for seed in range(4):
        save_photographs(tmp_path / "apart", 1, seed=seed, prefix=f"p{seed}")
    with pytest.raises(SceneError, match="none of the 4 photographs overlap enough") as refusal:
        found(tmp_path / "apart", tmp_path / "scene")
    assert "overlaps with no other photograph" in str(refusal.value)
    assert not (tmp_path / "scene" / "sparse").exists()


# without COLMAP


def test_without_pycolmap_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(process, "find_spec", lambda name: None)
    with pytest.raises(BackendError, match=r"pip install 'ringlight\[sfm\]'"):
        found(tmp_path, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_too_few_photographs(tmp_path: Path):
    save_photographs(tmp_path / "few", 2)
    with pytest.raises(SceneError, match="2 photographs, too few to find cameras"):
        found(tmp_path / "few", tmp_path / "out")
    for name in ("shot_00.png", "shot_01.png", "b.png"):
        (tmp_path / "few" / name).write_bytes(b"no picture")
    with pytest.raises(SceneError, match=r"only 0 of 3 photographs can be read; b\.png: not a readable image"):
        found(tmp_path / "few", tmp_path / "out")


def test_a_file_that_is_no_film(tmp_path: Path):
    (tmp_path / "a.txt").touch()
    with pytest.raises(SceneError, match="is neither a folder nor a film"):
        found(tmp_path / "a.txt", tmp_path / "out")


def _begun(tmp_path: Path) -> tuple[Path, Path]:
    """A folder of photographs, and a scene whose first stage failed."""
    photos, out = tmp_path / "photos", tmp_path / "out"
    photos.mkdir()
    for index in range(3):
        (photos / f"{index}.png").write_bytes(b"no picture")
    with pytest.raises(SceneError):
        found(photos, out)
    return photos, out


def test_a_scene_of_something_else_is_left_alone(tmp_path: Path):
    photos, out = _begun(tmp_path)
    other = tmp_path / "other"
    shutil.copytree(photos, other)
    with pytest.raises(RunError, match="holds the cameras of other photographs, those of"):
        found(other, out)
    with pytest.raises(RunError, match="these photographs with --seed 0"):
        found(photos, out, PosesOptions(lens="simple-pinhole", seed=1))
    (photos / "3.png").write_bytes(b"one more")
    with pytest.raises(RunError, match="before some were added, removed or changed"):
        found(photos, out)


def test_a_folder_that_holds_anything_else_is_refused_and_kept(tmp_path: Path):
    photos, _ = _begun(tmp_path)
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "novel.txt").write_text("chapter one")
    with pytest.raises(RunError, match="mine: is not an empty folder"):
        found(photos, mine)
    assert [path.name for path in mine.iterdir()] == ["novel.txt"]


def test_a_damaged_record_is_one_sentence(tmp_path: Path):
    photos, out = _begun(tmp_path)
    (out / run.RECORD_NAME).write_text("{")
    with pytest.raises(RunError, match=r"poses\.json: is damaged"):
        found(photos, out)


@pytest.mark.slow
def test_a_crash_of_colmap_is_one_sentence(tmp_path: Path):
    (tmp_path / "database.db").write_bytes(b"no database" * 1000)
    order = {"database": str(tmp_path / "database.db"), "pairs": [["a", "b"]], "scratch": str(tmp_path)}
    order |= {"threads": 1, "seed": 0}
    with pytest.raises(RunError, match=r"colmap\.log: COLMAP failed at matches \(.+\); what was done before is kept"):
        process.ask_colmap("matches", order, tmp_path, lambda done, total: None)
