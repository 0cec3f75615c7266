"""The experimental rasterizer, compiled and run beside ours on the same inputs: ``bench raster --against FOLDER``.

The folder holds kernel.cpp, bind.cpp, common.h and simd.h. It is compiled as its makers did: the kernel once for each
instruction set, nanobind from source, no torch. It takes activated scales and opacities, so its times lack the
activations that ours include.
"""

import importlib.util
import re
import shutil
import subprocess
import sysconfig
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import ModuleType

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.bench.raster import PeerMaker
from ringlight.bench.workload import Workload
from ringlight.errors import BackendError

SOURCES = ("kernel.cpp", "bind.cpp", "common.h", "simd.h")
COMPILERS = ("g++", "c++", "clang++")

FLAGS = ("-std=c++20", "-O3", "-ffp-contract=fast", "-fno-math-errno", "-fPIC", "-fvisibility=hidden", "-DNDEBUG", "-w")
ISA_FLAGS = {
    "k256": ("-march=x86-64-v3",),
    "k512": (
        "-march=x86-64-v4",
        *(f"-m{name}" for name in ("avx512vbmi", "avx512vbmi2", "avx512bitalg", "avx512vpopcntdq", "gfni")),
    ),
}
"""The kernel's namespace, and the flags with which that copy is compiled."""

VECTOR_BITS = {"avx2": 256, "avx512": 512, "avx512_bf16": 512, "avx512_amx": 512}
COMPILE_JOBS = 2
"""Each takes half a gigabyte."""

CHANNELS = (3, 4, 8, 16)
"""Widths it was compiled for; any other ends the process."""


def against(folder: Path, threads: int, isa: str, channels: int) -> PeerMaker:
    """Compile the rasterizer of ``folder`` and return what sets it up for a workload; half a minute.

    Raises BackendError where it cannot be compiled or does not blend this number of channels.
    """
    if channels not in CHANNELS:
        raise BackendError(
            f"{folder}: blends {', '.join(map(str, CHANNELS))} channels, not {channels}; choose one of them"
        )
    with tempfile.TemporaryDirectory(prefix="ringlight-against-") as build:
        module = _imported(_compiled(folder, Path(build)))
    state = module.R(threads, VECTOR_BITS[isa])
    return lambda work, upstream: _Prototype(state, work, upstream)


class _Prototype:
    """One workload in the arrays that it wants."""

    def __init__(self, state: object, work: Workload, upstream: Float[Tensor, "C H W"]):
        table, camera = work.gaussians, work.camera
        self.image = torch.empty_like(upstream)
        alpha = torch.empty(upstream.shape[1:])
        geometry = (table.means, table.quats, table.scales, table.opacities)
        inputs = [tensor.contiguous().numpy() for tensor in (*geometry, work.channels, camera.world_to_camera)]
        pinhole = (*camera.focal, *camera.center, camera.width, camera.height)
        background = torch.ones(work.size.channels).numpy()
        self._forward = (*inputs, *pinhole, background, self.image.numpy(), alpha.numpy())
        upstreams = (upstream.numpy(), torch.zeros_like(alpha).numpy())
        gradients = [torch.empty_like(tensor).numpy() for tensor in (*geometry, work.channels, table.means[:, :2])]
        self._backward = (self.image.numpy(), *upstreams, *gradients)
        self._state = state

    def forward(self) -> None:
        self._state.forward(*self._forward)  # type: ignore[attr-defined]

    def backward(self) -> None:
        self._state.backward(*self._backward)  # type: ignore[attr-defined]


def check_sources(folder: Path) -> None:
    """Raises BackendError where the folder holds no such rasterizer."""
    missing = [name for name in SOURCES if not (folder / name).is_file()]
    if missing:
        raise BackendError(f"{folder}: has no {missing[0]}; give the folder that holds {', '.join(SOURCES)}")


def _compiled(folder: Path, build: Path) -> Path:
    """The shared object, made in ``build``."""
    check_sources(folder)
    compiler = next((found for name in COMPILERS if (found := shutil.which(name))), None)
    if compiler is None:
        raise BackendError("no C++ compiler on this machine; install g++ 11 or newer to compare with another kernel")
    nanobind = _nanobind()
    includes = [folder, nanobind / "include", nanobind / "ext/robin_map/include", sysconfig.get_path("include")]
    common = [compiler, *FLAGS, *(f"-I{path}" for path in includes), "-c"]
    units = {f"{space}.o": [*flags, f"-DNS={space}", str(folder / "kernel.cpp")] for space, flags in ISA_FLAGS.items()}
    units["bind.o"] = [*ISA_FLAGS["k256"], str(folder / "bind.cpp")]
    units["nanobind.o"] = ["-fno-strict-aliasing", str(nanobind / "src" / "nb_combined.cpp")]
    with ThreadPoolExecutor(COMPILE_JOBS) as jobs:
        list(jobs.map(lambda unit: _call([*common, *unit[1], "-o", str(build / unit[0])], folder), units.items()))
    module = re.search(r"NB_MODULE\((\w+)", (folder / "bind.cpp").read_text(encoding="utf-8"))
    if module is None:
        raise BackendError(f"{folder / 'bind.cpp'}: declares no NB_MODULE; give another folder")
    library = build / f"{module[1]}{sysconfig.get_config_var('EXT_SUFFIX')}"
    _call([compiler, "-shared", *(str(build / name) for name in units), "-pthread", "-o", str(library)], folder)
    return library


def _nanobind() -> Path:
    """The folder of the installed nanobind, a requirement of builds but not of the program."""
    spec = importlib.util.find_spec("nanobind")
    if spec is None or spec.origin is None:
        raise BackendError("nanobind is needed to compile another kernel; install it: pip install nanobind")
    return Path(spec.origin).parent


def _call(command: list[str], folder: Path) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        complaint = next((line for line in done.stderr.splitlines() if "error" in line), f"code {done.returncode}")
        raise BackendError(f"{folder}: does not compile ({complaint.strip()}); check its files and the compiler")


def _imported(library: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(library.name.split(".")[0], library)
    if spec is None or spec.loader is None:
        raise BackendError(f"{library}: is no Python module; check bind.cpp")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
