"""What ``ringlight doctor`` looks at; each check is one finding with a remedy, and none of them raises."""

import importlib
import importlib.util
import os
import platform
import shutil
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Literal

from ringlight import __version__
from ringlight.core.cores import usable_cores
from ringlight.core.words import counted
from ringlight.errors import RinglightError

OLDEST_TORCH = (2, 5)

LITTLE_SPACE = 2e9
"""Bytes; a run of a real scene with its checkpoint and pictures takes up to about one gigabyte."""

AGREEMENT = 1e-3
"""Between two rasterizers in float32, relative to the largest value."""


@dataclass(frozen=True)
class Finding:
    """One line of the doctor's. ``essential``: without it nothing can be trained."""

    name: str
    state: Literal["ok", "missing", "problem"]
    detail: str
    remedy: str = ""
    essential: bool = False


def findings() -> Iterator[Finding]:
    """All checks, in the order in which one builds on the other; takes about a second, mostly to load torch."""
    yield Finding("Python", "ok", f"{platform.python_version()} at {sys.executable}, ringlight {__version__}")
    yield _kernels()
    yield _torch()
    yield _openmp()
    yield _self_test()
    yield from _lpips()
    yield _optional("av", "av", "films as mp4, and cameras of films", "video")
    yield _optional("COLMAP", "pycolmap", "cameras of photographs, by 'ringlight poses'", "sfm")
    yield from _gpu()
    yield _disk()


def _kernels() -> Finding:
    cores = usable_cores()
    try:
        kernels = importlib.import_module("ringlight._kernels")
        isa = kernels.isa()
        detail = f"{isa}, {counted(kernels.threads(), 'thread')} on {counted(cores, 'core')} ({platform.machine()})"
    except ImportError as error:
        remedy = 'build it again with "pip install ringlight", which needs a C++20 compiler'
        return Finding("kernels", "problem", f"the compiled module cannot be loaded: {error}", remedy, essential=True)
    except RuntimeError as error:
        return Finding("kernels", "problem", str(error), essential=True)  # it says its remedy
    if isa == "generic":  # it works, and the figures of the documents are not this machine's
        detail += "; several times slower than with AVX2"
    return Finding("kernels", "ok", detail)


def _torch() -> Finding:
    try:
        import torch
    except ImportError as error:
        return Finding("torch", "problem", f"cannot be loaded: {error}", "pip install torch", essential=True)
    gpu = f"CUDA {torch.version.cuda}" if torch.version.cuda else "CPU build"
    if torch.version.cuda:
        gpu += f", {torch.cuda.get_device_name()}" if torch.cuda.is_available() else ", no GPU found"
    detail = f"{torch.__version__}, {gpu}, {counted(torch.get_num_threads(), 'thread')}"
    if tuple(int(part) for part in torch.__version__.split(".")[:2]) < OLDEST_TORCH:
        oldest = ".".join(map(str, OLDEST_TORCH))
        return Finding("torch", "problem", detail, f'pip install --upgrade "torch>={oldest}"', essential=True)
    return Finding("torch", "ok", detail)


def _openmp() -> Finding:
    names = ("OMP_WAIT_POLICY", "OMP_NUM_THREADS", "KMP_BLOCKTIME", "GOMP_SPINCOUNT")
    detail = ", ".join(f"{name}={os.environ[name]}" for name in names if name in os.environ) or "nothing set"
    if os.environ.get("OMP_WAIT_POLICY", "").lower() == "active":
        remedy = "unset OMP_WAIT_POLICY: torch's idle threads would take the cores from the kernels"
        return Finding("OpenMP", "problem", detail, remedy)
    # It is read when torch is loaded: too late for a program that imports torch before ringlight.
    return Finding("OpenMP", "ok", f"{detail}; in programs of your own import ringlight before torch")


def _self_test() -> Finding:
    """A picture and its gradient by the fast rasterizer, against the reference."""
    try:
        difference = _difference_of_rasterizers()
    except ImportError as error:
        return Finding("self test", "problem", f"not possible: {error}", "see above", essential=True)
    except RinglightError as error:
        return Finding("self test", "problem", str(error), "see above", essential=True)
    detail = f"picture and gradient of a small scene agree with the reference to {difference:.0e}"
    # Written so that a difference that is not a number fails.
    if not difference < AGREEMENT:
        detail = f"picture or gradient of a small scene differ from the reference by {difference:.0e}"
        remedy = "report this with the output of 'ringlight doctor --json'; until then use --device reference"
        return Finding("self test", "problem", detail, remedy, essential=True)
    return Finding("self test", "ok", detail)


def _difference_of_rasterizers(ours: str = "cpu") -> float:
    import torch

    from ringlight.core.camera import Camera
    from ringlight.core.gaussians import GEOMETRY, Gaussians
    from ringlight.core.gradients import Gradients, dense
    from ringlight.core.rendering import Emission
    from ringlight.core.want import Want
    from ringlight.rasterize.choose import rasterizer_for

    generator = torch.Generator().manual_seed(0)
    count, size = 60, 32
    means = torch.randn(count, 3, generator=generator) * 0.6 + torch.tensor([0.0, 0.0, 4.0])
    table = Gaussians(
        means, torch.full((count, 3), -1.8), torch.randn(count, 4, generator=generator), torch.zeros(count)
    )
    colors = torch.rand(count, 3, generator=generator)
    camera = Camera(torch.eye(4), (40.0, 40.0), (size / 2, size / 2), size, size)
    results = []
    for name in (ours, "reference"):
        rasterize = rasterizer_for(name)
        there = rasterize.device
        columns = {column: getattr(table, column).to(there, copy=True) for column in GEOMETRY}
        emission, found = Emission({"rgb": 3}, colors.to(there)), Gradients()
        raster = rasterize.draw(Gaussians.from_columns(columns), emission, camera, torch.ones(3), want=Want.GRADIENTS)
        raster.backward(2 * raster.image, None, found)
        results.append([tensor.cpu() for tensor in (raster.image, *(dense(g) for g in found.values()))])
    pairs = zip(*results, strict=True)
    differences = [(mine - truth).abs().max() / truth.abs().max().clamp_min(1) for mine, truth in pairs]
    return torch.stack(differences).max().item()  # is no number where one of them is none, unlike Python's


def _gpu() -> Iterator[Finding]:
    """The GPU, all that its back end needs, and where kernels are built a picture by them."""
    from ringlight.cli.gpu_checks import gpu_findings
    from ringlight.cli.gpu_facts import gather

    facts = gather()
    yield from gpu_findings(facts)
    if facts.gpu is None or facts.gsplat is None or not facts.built:
        return
    try:
        difference = _difference_of_rasterizers("cuda")
    except (RinglightError, RuntimeError) as error:  # CUDA's own, of many lines, are of the second kind
        yield Finding("GPU test", "problem", str(error).partition("\n")[0], "use --device cpu")
        return
    detail = f"picture and gradient of a small scene differ from the reference by {difference:.0e}"
    fine = difference < AGREEMENT
    yield Finding("GPU test", "ok" if fine else "problem", detail, "" if fine else "use --device cpu")


def _lpips() -> Iterator[Finding]:
    try:
        from ringlight.measure.lpips import weights_damaged, weights_status
    except ImportError as error:
        yield Finding("LPIPS", "problem", f"not possible: {error}", "see above")
        return
    for net in ("alex", "vgg"):
        complaint = weights_status(net)
        if complaint == weights_damaged(net):
            yield Finding(f"LPIPS {net}", "problem", "weights are damaged", "ringlight fetch-lpips")
        elif complaint:
            yield Finding(f"LPIPS {net}", "missing", "weights are not here", "ringlight fetch-lpips")
        else:
            yield Finding(f"LPIPS {net}", "ok", "weights are here")


def _optional(name: str, package: str, does: str, extra: str) -> Finding:
    if importlib.util.find_spec(package) is None:
        return Finding(name, "missing", f"optional: {does}", f'pip install "ringlight[{extra}]"')
    try:
        number = version(package)
    except PackageNotFoundError:
        number = "of unknown version"
    return Finding(name, "ok", f"{number}: {does}")


def _disk() -> Finding:
    here = Path.cwd()
    free = shutil.disk_usage(here).free
    detail = f"{free / 1e9:.1f} GB free in {here}"
    if not os.access(here, os.W_OK):
        return Finding("disk", "problem", f"{here} cannot be written to", "change to a folder of yours or use --out")
    if free < LITTLE_SPACE:
        return Finding("disk", "problem", detail, "free some space or use --out on another disk")
    return Finding("disk", "ok", detail)
