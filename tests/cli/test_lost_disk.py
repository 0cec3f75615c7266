"""Where a disk or a network folder went away, the sentence says so, and not that a file is damaged."""

import errno
import io
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from command import Command
from scenes_on_disk import write_tiny_scene

from ringlight.core.lost_disk import MOUNT_AGAIN
from ringlight.errors import ModelFileError, OutputError, SceneError
from ringlight.files.atomic import write_text
from ringlight.files.tensor_file import read_tensors, write_tensors


@pytest.fixture
def lose(monkeypatch: pytest.MonkeyPatch) -> Callable[[Path], None]:
    """What lies below a folder cannot be opened any more."""

    def lost_from_now_on(folder: Path) -> None:
        opened = io.open

        def refusing(path: Any, *rest: Any, **more: Any) -> Any:
            if isinstance(path, str | os.PathLike) and str(path).startswith(str(folder)):
                raise OSError(errno.ESTALE, os.strerror(errno.ESTALE), str(path))
            return opened(path, *rest, **more)

        monkeypatch.setattr(io, "open", refusing)
        monkeypatch.setattr("builtins.open", refusing)

    return lost_from_now_on


def test_models_and_pictures_that_cannot_be_reached(tmp_path: Path, lose: Callable[[Path], None]):
    model = tmp_path / "model.safetensors"
    write_tensors(model, {"means": torch.zeros(2, 3)}, {})
    lose(tmp_path)
    with pytest.raises(ModelFileError, match=f"model.safetensors: cannot be read: Stale file handle; {MOUNT_AGAIN}"):
        read_tensors(model)
    with pytest.raises(OutputError, match=f"note.txt: cannot be written: Stale file handle; {MOUNT_AGAIN}"):
        write_text(tmp_path / "note.txt", "words")


def test_photographs_that_cannot_be_reached(tmp_path: Path, lose: Callable[[Path], None]):
    from ringlight.data.load import load_scene

    scene = load_scene(write_tiny_scene(tmp_path / "tiny"))
    lose(tmp_path / "tiny")
    with pytest.raises(SceneError, match=f"png: cannot be read .Stale file handle.; {MOUNT_AGAIN}"):
        scene.train[0].load()
    with pytest.raises(SceneError, match=MOUNT_AGAIN):
        load_scene(tmp_path / "tiny")


def test_a_run_whose_photographs_go_away_is_one_sentence(
    tmp_path: Path, ringlight: Command, lose: Callable[[Path], None]
):
    scene = write_tiny_scene(tmp_path / "tiny")
    lose(scene / "test")
    run = ringlight("train", scene, "3dgs", "--steps", 5, "--lpips", "--out", tmp_path / "run")
    assert run.code == 1
    assert run.err.rstrip().endswith(MOUNT_AGAIN)
    assert "Traceback" not in run.err
