"""What ``ringlight doctor`` finds out about GPUs, in environments that are made up."""

import json
import re
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from command import Command
from refusal import refused

from ringlight.cli import checks
from ringlight.cli.gpu_build import tell_of_build
from ringlight.cli.gpu_checks import gpu_findings
from ringlight.cli.gpu_facts import GpuFacts, gather, version_in
from ringlight.rasterize import choose
from ringlight.runs.record import RECORD_NAME

READY = GpuFacts(
    driver=True,
    torch_cuda=(12, 4),
    gpu="NVIDIA H100",
    capability=(9, 0),
    triton=True,
    gsplat="1.5.3",
    built=False,
    nvcc=(12, 4),
    architectures=frozenset({"compute_80", "compute_90"}),
    compiler="g++",
    gcc=13,
    ninja=True,
    ninja_beside=True,
    arch_list=None,
    free_bytes=32 << 30,
    max_jobs=None,
)


def found(facts: GpuFacts) -> dict[str, tuple[str, str, str]]:
    return {finding.name: (finding.state, finding.detail, finding.remedy) for finding in gpu_findings(facts)}


def test_a_machine_that_is_ready_has_nothing_to_mend():
    findings = found(READY)
    assert {state for state, _, _ in findings.values()} == {"ok"}
    assert {"GPU", "triton", "gsplat", "nvcc", "GPU build", "C++ for GPU", "ninja", "build memory"} == set(findings)
    assert "takes minutes" in findings["gsplat"][1]


def test_built_kernels_need_no_compiler():
    findings = found(replace(READY, built=True, nvcc=None, compiler=None, ninja=False))
    assert set(findings) == {"GPU", "triton", "gsplat"}


def test_without_a_gpu_nothing_else_is_asked():
    findings = found(replace(READY, driver=False, torch_cuda=None, gpu=None, capability=None))
    assert set(findings) == {"GPU"}
    assert findings["GPU"][0] == "missing", "no problem: ringlight trains on the CPU"


@pytest.mark.parametrize(
    ("change", "name", "detail", "remedy"),
    [
        ({"torch_cuda": None, "gpu": None}, "GPU", "CPU build", "pip install --force-reinstall torch"),
        ({"gpu": None}, "GPU", "CUDA 12.4 finds no GPU", "driver"),
        ({"triton": False}, "triton", "torch operations", "pip install triton"),
        ({"gsplat": None}, "gsplat", "optional", r'pip install "ringlight\[cuda\]"'),
        ({"gsplat": "1.4.0"}, "gsplat", "1.4.0 is too old", "ringlight"),
        ({"nvcc": None}, "nvcc", "no CUDA compiler", "toolkit 12.4"),
        ({"nvcc": (13, 0)}, "nvcc", "13.0, torch was built with 12.4", "toolkit 12.4"),
        ({"capability": (12, 0)}, "GPU build", "cannot compile for sm_120", "newer CUDA toolkit"),
        ({"arch_list": "8.0;8.6"}, "GPU build", "leaves out this GPU, 9.0", "unset TORCH_CUDA_ARCH_LIST"),
        ({"compiler": None}, "C++ for GPU", r"no C\+\+ compiler", "apt install g"),
        ({"gcc": 14}, "C++ for GPU", "does not accept GCC 14", "CXX=g..-13"),
        ({"nvcc": (12, 9), "gcc": 15}, "C++ for GPU", "does not accept GCC 15", "CXX=g..-14"),
        ({"ninja": False}, "ninja", "not on PATH", "activate"),
        ({"ninja": False, "ninja_beside": False}, "ninja", "not installed", "pip install ninja"),
        ({"free_bytes": 1 << 30}, "build memory", "1.1 GB free", "end other programs"),
        ({"free_bytes": 8 << 30, "max_jobs": "10"}, "build memory", "MAX_JOBS=10", "MAX_JOBS=2"),
    ],
)
def test_each_thing_that_breaks_a_build_has_a_remedy(change: dict[str, object], name: str, detail: str, remedy: str):
    findings = found(replace(READY, **change))
    state, told, mending = findings[name]
    assert state != "ok"
    assert re.search(detail, told)
    assert re.search(remedy, mending)
    others = {other: state for other, (state, _, _) in findings.items() if other != name}
    assert set(others.values()) <= {"ok"}, "one cause, one complaint"


def test_versions_are_read_from_what_nvcc_says():
    assert version_in("Cuda compilation tools, release 12.4, V12.4.131") == (12, 4)
    assert version_in("nvcc: command not found") is None


@pytest.mark.parametrize(
    ("device", "gpu", "built", "told"),
    [("cuda", True, False, True), ("auto", True, False, True), ("cpu", True, False, False), ("auto", True, True, False),
     ("auto", False, False, False)],
)  # fmt: skip
def test_a_build_is_told_of_before_it_begins(device, gpu, built, told, monkeypatch, capsys):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: name)
    monkeypatch.setattr("ringlight.rasterize.choose.has_gpu", lambda: gpu)
    monkeypatch.setattr("ringlight.rasterize.gsplat_build.is_built", lambda: built)
    tell_of_build(device)
    assert ("building gsplat's kernels" in capsys.readouterr().err) == told


def test_gathering_on_this_machine_does_not_raise():
    facts = gather()
    assert facts.free_bytes > 0
    assert list(gpu_findings(facts))


@pytest.fixture
def damaged_gsplat(tmp_path, monkeypatch):
    """A package of that name that cannot be imported."""
    (tmp_path / "gsplat").mkdir()
    (tmp_path / "gsplat" / "__init__.py").write_text("raise OSError('libcudart.so: cannot open shared object file')")
    monkeypatch.syspath_prepend(tmp_path)
    for name in [name for name in sys.modules if name.partition(".")[0] == "gsplat"]:
        monkeypatch.delitem(sys.modules, name)


@pytest.mark.usefixtures("damaged_gsplat")
def test_where_gsplat_cannot_be_loaded_the_cpu_draws_and_a_sentence_says_why(
    monkeypatch, trained: dict[str, Path], ringlight: Command
):
    monkeypatch.setattr(choose, "has_gpu", lambda: True)
    choose._gsplat_works.cache_clear()
    words = ("eval", trained["3dgs"] / "model.safetensors", "--lpips", "--quiet")
    done = ringlight(*words)
    choose._gsplat_works.cache_clear()
    assert done.code == 0, done.err
    *_, last = done.err.splitlines()
    assert last.startswith(
        "warning: the CPU draws, since gsplat, which draws on the GPU, cannot be loaded (libcudart.so"
    )
    assert last.endswith("--device cuda insists on the GPU")
    insisted = ringlight(*words, "--device", "cuda")
    assert insisted.code == 1
    assert "libcudart.so" in insisted.err


@pytest.mark.usefixtures("damaged_gsplat")
def test_a_gsplat_that_cannot_be_imported_does_not_stop_doctor():
    facts = gather()
    assert facts.gsplat is None
    assert list(gpu_findings(facts))


def test_kernels_that_fail_on_the_gpu_are_a_finding(monkeypatch):
    def fail(_: str) -> float:
        raise RuntimeError("CUDA error: no kernel image is available for execution on the device\nCompile with ...")

    monkeypatch.setattr("ringlight.cli.gpu_facts.gather", lambda: replace(READY, built=True))
    monkeypatch.setattr(checks, "_difference_of_rasterizers", fail)
    *_, last = checks._gpu()
    assert (last.state, last.remedy) == ("problem", "use --device cpu")
    assert last.detail.endswith("on the device")


def test_a_missing_gpu_is_told_before_the_scene_is_read(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, ringlight: Command
) -> None:
    monkeypatch.setattr(choose, "has_gpu", lambda: False)
    done = ringlight("train", "toaster", "3dgs", "--device", "cuda", "--out", tmp_path / "run")
    refused(done, 1, "torch finds no NVIDIA GPU on this machine", "--device cpu")
    assert "photographs" not in done.err
    assert not list(tmp_path.iterdir())


def test_a_run_that_needs_a_gpu_is_not_resumed_without_one(
    monkeypatch: pytest.MonkeyPatch, trained: dict[str, Path], tmp_path: Path, ringlight: Command
) -> None:
    run = shutil.copytree(trained["3dgs"], tmp_path / "run")
    written = run / RECORD_NAME
    record = json.loads(written.read_text())
    assert "device" in record
    written.write_text(json.dumps(record | {"device": "cuda"}))
    monkeypatch.setattr("ringlight.runs.resume.has_gpu", lambda: False)
    done = ringlight("train", "--resume", run)
    refused(done, 1, "was begun with --device cuda", "no NVIDIA GPU", "3dgs --device cpu --out NEW")
    assert "photographs" not in done.err


def test_verify_tells_of_a_missing_gpu_before_the_scene_is_read(
    monkeypatch: pytest.MonkeyPatch, ringlight: Command
) -> None:
    monkeypatch.setattr(choose, "has_gpu", lambda: False)
    done = ringlight("train", "toaster", "3dgs", "--device", "cuda", "--verify", "2")
    refused(done, 1, "torch finds no NVIDIA GPU on this machine")
    assert "photographs" not in done.err
