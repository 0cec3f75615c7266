"""The public surface: complete, loaded lazily, and the map of the architecture is of this code."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

import ringlight

ROOT = Path(__file__).parents[1]


def test_every_public_name_can_be_had():
    assert set(ringlight.__all__) == set(ringlight._HOMES)
    assert all(getattr(ringlight, name) is not None for name in ringlight.__all__)


def test_an_unknown_name_is_an_attribute_error():
    assert not hasattr(ringlight, "no_such_name")


def test_paths_may_be_text(tmp_path):
    with pytest.raises(ringlight.RinglightError, match="no such folder"):
        ringlight.load_scene(str(tmp_path / "missing"))
    with pytest.raises(ringlight.RinglightError, match="no such file"):
        ringlight.load_model(str(tmp_path / "missing"), ringlight.rasterizer_for("reference"))
    with pytest.raises(ringlight.RinglightError, match="no such run"):
        ringlight.compare([str(tmp_path / "missing")])
    with pytest.raises(ringlight.RinglightError, match="no such file"):
        ringlight.read_gaussian_ply(str(tmp_path / "missing.ply"))


def test_importing_the_package_does_not_import_torch():
    code = "import sys, ringlight; sys.exit('torch' in sys.modules or 'numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_every_folder_of_the_package_is_on_the_map():
    map_of_folders = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    folders = [p.name for p in (ROOT / "src" / "ringlight").iterdir() if (p / "__init__.py").exists()]
    assert folders
    assert [name for name in folders if f"`{name}`" not in map_of_folders] == []


def test_files_named_by_the_documents_exist():
    missing = []
    documents = ("conventions", "reliability", "cuda", "extending")
    for document in ("ARCHITECTURE.md", "CONTRIBUTING.md", *(f"docs/{name}.md" for name in documents)):
        for name in re.findall(
            r"`((?:[a-z_]+/)+[a-z_]+(?:\.isa)?\.(?:py|cpp|hpp))`", (ROOT / document).read_text(encoding="utf-8")
        ):
            if name.rsplit("/", 1)[-1] == "x.py":
                continue
            if not any((ROOT / base / name).exists() for base in ("", "src/ringlight", "kernels")):
                missing.append(f"{document}: {name}")
    assert missing == []


def test_source_files_stay_short():
    """One idea a file: 400 lines need a reason, and there is none yet."""
    files = [*ROOT.glob("src/**/*.py"), *ROOT.glob("kernels/**/*.[ch]pp")]
    assert [str(f.relative_to(ROOT)) for f in files if len(f.read_text(encoding="utf-8").splitlines()) > 400] == []


def test_the_oldest_torch_that_doctor_accepts_is_the_one_that_is_asked_for():
    from ringlight.cli.checks import OLDEST_TORCH

    project = ROOT / "pyproject.toml"
    if not project.is_file():
        pytest.skip("needs the source tree")
    [floor] = re.findall(r'"torch>=([\d.]+)"', project.read_text(encoding="utf-8"))
    assert tuple(map(int, floor.split("."))) == OLDEST_TORCH
    assert OLDEST_TORCH >= (2, 5), "increment_version takes several tensors since then (fit/adam.py)"
