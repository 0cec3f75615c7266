"""What every export format must do, parametrised over the table and the plug."""

import errno
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from contracts.methods import TRAINED, small
from plugs.splat_format import BYTES_EACH, SplatFile
from ringlight.errors import OutputError
from ringlight.files.formats import table
from ringlight.files.formats.contract import Content, Form, Writer
from ringlight.files.ply import read_gaussian_ply
from ringlight.fit.train import train
from ringlight.methods.store import StoredModel, model_header, scene_facts
from ringlight.rasterize.choose import rasterizer_for
from ringlight.runs.export import export
from tiny_scene import tiny_scene

SUFFIXES: dict[str, Writer] = dict(table.WRITERS) | {".splat": SplatFile()}


def splat_means(path: Path) -> Tensor:
    rows = np.frombuffer(path.read_bytes(), np.uint8).reshape(-1, BYTES_EACH)
    return torch.from_numpy(rows[:, :12].copy()).view(torch.float32)


MEANS: dict[str, Callable[[Path], Tensor]] = {
    ".ply": lambda path: read_gaussian_ply(path).gaussians.means,
    ".splat": splat_means,
}
"""The centres of a file's Gaussians [N 3]."""

pytestmark = [pytest.mark.parametrize("suffix", SUFFIXES)]


@pytest.fixture(autouse=True)
def plugged(monkeypatch: pytest.MonkeyPatch):
    """One line in the table."""
    monkeypatch.setitem(table.WRITERS, ".splat", SUFFIXES[".splat"])


def full_disk(handle: int) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def stored(name: str) -> StoredModel:
    scene, recipe = tiny_scene(views=6, size=24), small(name, 8)
    training = recipe.build(scene, rasterizer_for("auto"), 0)
    for _ in train(training):
        pass
    cameras = tuple(view.camera for view in scene.train)
    return StoredModel(training.model, _header(name, recipe, scene), cameras, rasterizer_for("auto"))


def _header(name: str, recipe: object, scene: object):
    preset = name if name in ("3dgs", "ringlight-ring", "ringlight-mirror") else "3dgs"
    return model_header(preset, TRAINED[preset], 8, scene_facts(scene))


def test_it_says_what_it_takes_and_who_opens_it(suffix: str):
    writer = SUFFIXES[suffix]
    assert isinstance(writer, Writer)
    assert writer.form in Form
    assert writer.about


@pytest.mark.parametrize("name", ["3dgs", "ringlight-ring", "ringlight-mirror", "directional-opacity", "environment"])
def test_what_is_written_has_a_row_a_gaussian(suffix: str, name: str, tmp_path: Path):
    """Colours that are no harmonics are fitted, and what that loses is told."""
    path, model = tmp_path / f"model{suffix}", stored(name)
    exported = export(model, path, fit_steps=2)
    assert exported.bytes_file == path.stat().st_size > 0
    assert (exported.loss is None) == (name == "3dgs")
    if exported.loss is not None:
        assert exported.loss.picture_psnr > 0
    assert len(MEANS[suffix](path)) == exported.counted


def test_the_same_model_gives_the_same_bytes(suffix: str, tmp_path: Path):
    model = stored("3dgs")
    paths = [tmp_path / f"{number}{suffix}" for number in range(2)]
    for path in paths:
        export(model, path)
    assert paths[0].read_bytes() == paths[1].read_bytes()


def test_what_a_model_cannot_give_is_refused_before_anything_is_written(suffix: str, tmp_path: Path):
    path = tmp_path / f"model{suffix}"
    with pytest.raises(OutputError, match="voxels"):
        export(stored("voxels"), path)
    assert not list(tmp_path.iterdir())


def test_a_write_that_fails_leaves_what_was_there(suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path, model = tmp_path / f"model{suffix}", stored("3dgs")
    export(model, path)
    before = path.read_bytes()
    columns = dict(model.model.splats().gaussians.columns())
    other = Content(columns | {"sh_dc": columns["sh_dc"] + 0.5}, False, ())
    monkeypatch.setattr(os, "fsync", full_disk)
    with pytest.raises(OutputError, match=rf"model\{suffix}: cannot be written: no space is left on the disk"):
        SUFFIXES[suffix].write(path, other)
    assert path.read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


def test_numbers_come_back(suffix: str, tmp_path: Path):
    model, path = stored("3dgs"), tmp_path / f"model{suffix}"
    export(model, path)
    means = model.model.splats().gaussians.means
    found = MEANS[suffix](path)
    assert torch.equal(found.sort(0).values, means.detach().sort(0).values)
