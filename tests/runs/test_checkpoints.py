"""The last two checkpoints: whole ones after any interruption, and a damaged one gives way to the one before."""

import errno
import os
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from ringlight.errors import ModelFileError, OutputError, RunError
from ringlight.files.atomic import BEGUN, HALF_DONE, sweep
from ringlight.fit.train import Training, train
from ringlight.rasterize.choose import rasterizer_for
from ringlight.runs.checkpoints import read_checkpoint, refuse_misfits, write_checkpoint
from ringlight.runs.folder import RunFolder
from small_recipes import small
from tiny_scene import tiny_scene

NAMES = {"checkpoint.safetensors", "checkpoint-earlier.safetensors"}


def save(folder: RunFolder, step: int) -> None:
    write_checkpoint(folder, {"step": torch.tensor(step), "values": torch.arange(100.0)}, {"step": str(step)})


def step_of(folder: RunFolder) -> int:
    return int(read_checkpoint(folder)[0].tensors["step"])


@pytest.fixture
def folder(tmp_path: Path) -> RunFolder:
    for step in (1, 2, 3):
        save(RunFolder(tmp_path), step)
    return RunFolder(tmp_path)


def test_the_last_two_are_kept(folder: RunFolder) -> None:
    assert {path.name for path in folder.path.iterdir()} == NAMES
    assert step_of(folder) == 3
    folder.checkpoint.unlink()
    assert step_of(folder) == 2


@pytest.mark.parametrize("place", [0, 9, 40, -1, -200])
def test_a_damaged_one_is_named_and_the_older_used(folder: RunFolder, place: int) -> None:
    content = bytearray(folder.checkpoint.read_bytes())
    content[place] ^= 1
    folder.checkpoint.write_bytes(content)
    stored, warnings = read_checkpoint(folder)
    assert int(stored.tensors["step"]) == 2
    assert len(warnings) == 1
    assert str(folder.checkpoint) in warnings[0]
    assert "checkpoint-earlier.safetensors" in warnings[0]


def test_where_all_are_damaged_the_newest_is_named(folder: RunFolder) -> None:
    for name in NAMES:
        (folder.path / name).write_bytes(b"")
    with pytest.raises(ModelFileError, match=r"/checkpoint\.safetensors: the file is empty"):
        read_checkpoint(folder)


def test_where_there_is_none_that_is_said(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="no checkpoint yet"):
        read_checkpoint(RunFolder(tmp_path))


@pytest.mark.parametrize("renames", [0, 1])
def test_killed_between_its_renames_a_save_is_not_lost(
    folder: RunFolder, renames: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    replace, done = Path.replace, []

    def killed(path: Path, target: Path) -> None:
        if path.name.startswith("checkpoint") and len(done) == renames:
            raise KeyboardInterrupt
        done.extend([path] * path.name.startswith("checkpoint"))
        replace(path, target)

    with monkeypatch.context() as patched:
        patched.setattr(Path, "replace", killed)
        with pytest.raises(KeyboardInterrupt):
            save(folder, 4)
    assert step_of(folder) == 4
    save(folder, 5)
    assert step_of(folder) == 5
    assert {path.name for path in folder.path.iterdir()} == NAMES


@pytest.mark.parametrize("call", ["fsync", "write"])
@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EIO])
def test_a_disk_that_fails_leaves_both(
    folder: RunFolder, call: str, code: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = {path.name: path.read_bytes() for path in folder.path.iterdir()}
    opened = Path.open

    def fail(*_: object) -> None:
        raise OSError(code, os.strerror(code))

    def on_a_bad_disk(path: Path, mode: str = "r") -> object:
        file = opened(path, mode, buffering=0)
        if "x" not in mode:
            return file
        return FailingFile(file)

    with monkeypatch.context() as patched:
        if call == "fsync":
            patched.setattr(os, "fsync", fail)
        else:
            patched.setattr(Path, "open", on_a_bad_disk)
        with pytest.raises(OutputError):
            save(folder, 4)
    assert {path.name: path.read_bytes() for path in folder.path.iterdir()} == before


class FailingFile:
    """Takes some bytes, then the disk is full."""

    def __init__(self, file) -> None:  # type: ignore[no-untyped-def]
        self.file, self.room = file, 300

    def __enter__(self) -> "FailingFile":
        return self

    def __exit__(self, *_: object) -> None:
        self.file.close()

    def write(self, data: bytes) -> None:
        self.file.write(memoryview(data)[: self.room])
        self.room -= len(data)
        if self.room < 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_what_killed_writers_left_is_swept_up(folder: RunFolder) -> None:
    (folder.path / f"{BEGUN}0123{HALF_DONE}").write_bytes(b"half")
    (folder.path / "mine.part").write_bytes(b"mine")
    sweep(folder.path)
    assert {path.name for path in folder.path.iterdir()} == NAMES | {"mine.part"}


def guarded() -> Training:
    return small("ringlight-ring", steps=12).build(tiny_scene(views=3, size=16), rasterizer_for("auto"), seed=0)


def test_the_state_that_a_guard_keeps_must_fit_like_the_other() -> None:
    training = guarded()
    for _ in train(training):
        pass
    state = training.state()
    kept = {name for name in state if name.startswith("guard.good.")}
    assert {name.removeprefix("guard.good.") for name in kept} == {n for n in state if not n.startswith("guard.")}
    refuse_misfits(state, guarded())
    refuse_misfits({name: tensor for name, tensor in state.items() if name not in kept}, guarded())
    for name in sorted(kept):
        lacking = {other: tensor for other, tensor in state.items() if other != name}
        with pytest.raises(KeyError):
            refuse_misfits(lacking, guarded())
        if state[name].ndim > 1:
            with pytest.raises(ValueError, match="of shape"):
                refuse_misfits(state | {name: state[name][:, :-1]}, guarded())
    with pytest.raises(ValueError, match="is unknown"):
        refuse_misfits(state | {"guard.good.model.columns.weight": torch.zeros(3)}, guarded())
    with pytest.raises(ValueError, match="counts"):
        refuse_misfits(state | {"guard.good.step": torch.tensor(-1)}, guarded())


@pytest.mark.parametrize("method", ["ringlight-ring", "ringlight-mirror", "3dgs"])
def test_a_run_goes_on_in_the_midst_of_a_mean_of_models(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ringlight.fit.guard.CHECK_EVERY", 1)

    def averaging() -> Training:
        recipe = replace(small(method, steps=40), average=0.2)
        return recipe.build(tiny_scene(views=3, size=16), rasterizer_for("auto"), seed=0)

    whole, stopped, resumed = averaging(), averaging(), averaging()
    for _ in train(whole):
        pass
    for _ in train(stopped):
        if stopped.step == 36:
            break
    state = {name: tensor.clone() for name, tensor in stopped.state().items()}
    means = {name for name in state if ".columns.means" in name and "strategy." in name}
    assert {name.split(".")[0] for name in means} == ({"strategy"} if method == "3dgs" else {"strategy", "guard"})
    refuse_misfits(state, averaging())
    for name in sorted(means):
        with pytest.raises(ValueError, match="of shape"):
            refuse_misfits(state | {name: torch.zeros(3, 3, 3, 3)}, averaging())
        with pytest.raises(ValueError, match=r"\.columns\.means is missing"):
            refuse_misfits({other: tensor for other, tensor in state.items() if other != name}, averaging())
    with pytest.raises(ValueError, match=r"strategy\.9\.columns\.mine is unknown"):
        refuse_misfits(state | {"strategy.9.columns.mine": torch.zeros(3)}, averaging())
    resumed.restore(state)
    for _ in train(resumed):
        pass
    ends = whole.model.state_dict(), resumed.model.state_dict()
    assert all(torch.equal(tensor, ends[1][name]) for name, tensor in ends[0].items())
