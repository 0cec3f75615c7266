"""What of a machine's GPU works, and what would break the build of gsplat's kernels before it starts.

Each finding ends with one remedy. All of them are optional: ringlight trains without a GPU.
"""

from collections.abc import Iterator

from ringlight.cli.checks import Finding
from ringlight.cli.gpu_facts import GpuFacts, Version
from ringlight.core.words import counted
from ringlight.rasterize.gsplat_build import JOB_BYTES, MOST_JOBS, OLDEST_GSPLAT, version_of

NEWEST_GCC = {(11, 8): 11, (12, 0): 12, (12, 1): 12, (12, 4): 13, (12, 8): 14, (13, 0): 15}
"""Newest GCC that nvcc accepts, of this version and up to the next one here (NVIDIA's installation guide)."""


def gpu_findings(facts: GpuFacts) -> Iterator[Finding]:
    """The GPU itself, the packages, and where gsplat's kernels are not built yet all that their build needs."""
    gpu = _gpu(facts)
    yield gpu
    if gpu.state != "ok":
        return
    yield _triton(facts)
    gsplat = _gsplat(facts)
    yield gsplat
    if gsplat.state != "ok" or facts.built:
        return
    yield _nvcc(facts)
    yield _architecture(facts)
    yield _compiler(facts)
    yield _ninja(facts)
    yield _memory(facts)


def _gpu(facts: GpuFacts) -> Finding:
    if facts.gpu is not None and facts.torch_cuda is not None:
        return Finding("GPU", "ok", f"{facts.gpu}, {_sm(facts.capability)}, torch for CUDA {_dots(facts.torch_cuda)}")
    if not facts.driver:
        return Finding("GPU", "missing", "optional: no NVIDIA driver answers", "everything runs on the CPU")
    if facts.torch_cuda is None:
        remedy = "install a CUDA build: pip install --force-reinstall torch (see pytorch.org for your CUDA)"
        return Finding("GPU", "problem", "there is a driver, but torch is a CPU build", remedy)
    detail = f"there is a driver, but torch for CUDA {_dots(facts.torch_cuda)} finds no GPU"
    return Finding("GPU", "problem", detail, "update NVIDIA's driver, or unset CUDA_VISIBLE_DEVICES if that hides it")


def _triton(facts: GpuFacts) -> Finding:
    if facts.triton:
        return Finding("triton", "ok", "loss, Adam and light field have kernels of their own")
    return Finding("triton", "missing", "loss, Adam and light field run as torch operations", "pip install triton")


def _gsplat(facts: GpuFacts) -> Finding:
    install = 'pip install "ringlight[cuda]"'
    if facts.gsplat is None:
        return Finding("gsplat", "missing", "optional: draws on the GPU", install)
    if version_of(facts.gsplat) < OLDEST_GSPLAT:
        return Finding("gsplat", "problem", f"{facts.gsplat} is too old", install)
    if facts.built:
        return Finding("gsplat", "ok", f"{facts.gsplat}, kernels are built")
    return Finding("gsplat", "ok", f"{facts.gsplat}, kernels are built at the first use, which takes minutes")


def _nvcc(facts: GpuFacts) -> Finding:
    wanted = facts.torch_cuda or (0, 0)
    toolkit = f"install the CUDA toolkit {_dots(wanted)} and set CUDA_HOME to its folder"
    if facts.nvcc is None:
        return Finding("nvcc", "problem", "there is no CUDA compiler to build gsplat's kernels with", toolkit)
    detail = f"{_dots(facts.nvcc)}, torch was built with {_dots(wanted)}"
    if facts.nvcc[0] != wanted[0]:  # torch refuses other major versions, and warns of minor ones
        return Finding("nvcc", "problem", detail, toolkit)
    return Finding("nvcc", "ok", detail)


def _architecture(facts: GpuFacts) -> Finding:
    name = "GPU build"
    if facts.capability is None:
        return Finding(name, "missing", "the GPU's architecture is not known", "update NVIDIA's driver")
    major, minor = facts.capability
    here = f"{major}.{minor}"
    if facts.nvcc and facts.architectures and f"compute_{major}{minor}" not in facts.architectures:
        remedy = f"install a newer CUDA toolkit of the major version {facts.nvcc[0]}, and torch for it"
        return Finding(name, "problem", f"nvcc {_dots(facts.nvcc)} cannot compile for {_sm(facts.capability)}", remedy)
    if facts.arch_list and here not in facts.arch_list:
        detail = f"TORCH_CUDA_ARCH_LIST={facts.arch_list} leaves out this GPU, {here}"
        return Finding(name, "problem", detail, "unset TORCH_CUDA_ARCH_LIST")
    return Finding(name, "ok", f"nvcc compiles for {_sm(facts.capability)}")


def _compiler(facts: GpuFacts) -> Finding:
    name = "C++ for GPU"
    if facts.compiler is None:
        return Finding(name, "problem", "no C++ compiler", "install g++ (Debian: apt install g++)")
    known = [version for version in NEWEST_GCC if facts.nvcc and version <= facts.nvcc]
    newest = NEWEST_GCC[max(known)] if known else None
    if newest and facts.gcc and facts.gcc > newest:
        remedy = f"install g++-{newest} and set CC=gcc-{newest} CXX=g++-{newest}"
        return Finding(name, "problem", f"nvcc {_dots(facts.nvcc)} does not accept GCC {facts.gcc}", remedy)
    return Finding(name, "ok", f"{facts.compiler}{f', GCC {facts.gcc}' if facts.gcc else ''}")


def _ninja(facts: GpuFacts) -> Finding:
    if facts.ninja:
        return Finding("ninja", "ok", "on PATH")
    if facts.ninja_beside:
        detail = "installed, but not on PATH, where torch looks for it"
        return Finding("ninja", "problem", detail, "activate the environment (source .venv/bin/activate)")
    return Finding("ninja", "problem", "not installed", "pip install ninja")


def _memory(facts: GpuFacts) -> Finding:
    free = f"{facts.free_bytes / 1e9:.1f} GB free"
    fits = facts.free_bytes // JOB_BYTES
    if facts.max_jobs and facts.max_jobs.isdigit() and int(facts.max_jobs) > max(fits, 1):
        detail = f"{free}, and MAX_JOBS={facts.max_jobs} compilers take up to {JOB_BYTES >> 30} GB each"
        return Finding("build memory", "problem", detail, f"set MAX_JOBS={max(fits, 1)}, or unset it")
    if fits < 1:
        detail = f"{free}, one compiler of gsplat's kernels takes up to {JOB_BYTES >> 30} GB"
        return Finding("build memory", "problem", detail, "end other programs while it builds")
    return Finding("build memory", "ok", f"{free}: {counted(min(fits, MOST_JOBS), 'compiler')} at a time")


def _dots(version: Version | None) -> str:
    return "of unknown version" if version is None else f"{version[0]}.{version[1]}"


def _sm(capability: Version | None) -> str:
    return "unknown architecture" if capability is None else f"sm_{capability[0]}{capability[1]}"
