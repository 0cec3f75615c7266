"""What this machine has for drawing on a GPU, gathered without building anything; nothing here raises."""

import contextlib
import importlib
import importlib.util
import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

Version = tuple[int, int]

SECONDS = 10
"""Longest wait for a program's answer."""


@dataclass(frozen=True)
class GpuFacts:
    """None where something is not there, or does not say."""

    driver: bool
    """Whether NVIDIA's driver is installed (``nvidia-smi`` answers)."""
    torch_cuda: Version | None
    """CUDA that torch was built with; None for a CPU build."""
    gpu: str | None
    """Name of the GPU that torch would use."""
    capability: Version | None
    """Its architecture: (9, 0) is sm_90."""
    triton: bool
    gsplat: str | None
    """Version of the package."""
    built: bool
    """Whether gsplat's kernels are compiled already."""
    nvcc: Version | None
    architectures: frozenset[str]
    """What nvcc can compile for, "compute_90"; empty where it does not say."""
    compiler: str | None
    """Name of the C++ compiler."""
    gcc: int | None
    """Its major version, if it is GCC."""
    ninja: bool
    """On PATH, where torch looks for it."""
    ninja_beside: bool
    """In this environment's folder, although not on PATH."""
    arch_list: str | None
    """TORCH_CUDA_ARCH_LIST: architectures that somebody wants builds to be for."""
    free_bytes: int
    """Memory that programs may still have."""
    max_jobs: str | None
    """MAX_JOBS: compilers at a time that somebody wants."""


def gather() -> GpuFacts:
    """Of this machine, now."""
    from ringlight.rasterize.gsplat_build import free_memory, is_built

    torch_cuda, gpu, capability = _torch()
    nvcc = _nvcc()
    wanted = os.environ.get("CXX")
    compiler = next(filter(shutil.which, [wanted] if wanted else ["c++", "g++"]), None)
    gcc = _answer([compiler, "-dumpfullversion"]) if compiler else None
    return GpuFacts(
        driver=shutil.which("nvidia-smi") is not None and _answer(["nvidia-smi", "-L"]) is not None,
        torch_cuda=torch_cuda,
        gpu=gpu,
        capability=capability,
        triton=importlib.util.find_spec("triton") is not None,
        gsplat=_gsplat(),
        built=is_built(),
        nvcc=version_in(_answer([nvcc, "--version"]) or "") if nvcc else None,
        architectures=frozenset((_answer([nvcc, "--list-gpu-arch"]) or "").split() if nvcc else ()),
        compiler=compiler,
        gcc=int(gcc.split(".")[0]) if gcc and gcc.split(".")[0].strip().isdigit() else None,
        ninja=shutil.which("ninja") is not None,
        ninja_beside=(Path(sys.executable).parent / "ninja").exists(),
        arch_list=os.environ.get("TORCH_CUDA_ARCH_LIST"),
        free_bytes=free_memory(),
        max_jobs=os.environ.get("MAX_JOBS"),
    )


def version_in(answer: str) -> Version | None:
    """(12, 4) of "Cuda compilation tools, release 12.4, V12.4.131"."""
    found = re.search(r"release (\d+)\.(\d+)", answer)
    return (int(found[1]), int(found[2])) if found else None


def _torch() -> tuple[Version | None, str | None, Version | None]:
    try:
        import torch
    except ImportError:
        return None, None, None
    built = torch.version.cuda
    cuda = None if built is None else (int(built.split(".")[0]), int(built.split(".")[1]))
    if not torch.cuda.is_available():
        return cuda, None, None
    return cuda, torch.cuda.get_device_name(), torch.cuda.get_device_capability()


def _gsplat() -> str | None:
    with contextlib.suppress(Exception):  # whatever a damaged package raises when it is imported
        return str(importlib.import_module("gsplat").__version__)
    return None


def _nvcc() -> str | None:
    """Where torch would look: CUDA_HOME, then PATH, then the usual folder."""
    home = os.environ.get("CUDA_HOME") or os.environ.get("CUDA_PATH")
    places = [f"{home}/bin/nvcc"] if home else []
    return next(filter(None, map(shutil.which, [*places, "nvcc", "/usr/local/cuda/bin/nvcc"])), None)


def _answer(command: list[str]) -> str | None:
    """Standard output of a program; None if it fails."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS, check=False)
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout if done.returncode == 0 else None
