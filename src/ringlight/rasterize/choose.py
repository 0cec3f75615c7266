"""From the name a user gave to a back end, or to the sentence that says why there is none."""

import functools
import importlib
import importlib.util
import warnings
from collections.abc import Callable

from ringlight.errors import BackendError, FallbackWarning
from ringlight.rasterize.contract import Rasterizer


def rasterizer_for(name: str = "auto") -> Rasterizer:
    """The back end called ``name``: "cuda", "cpu", "reference", or "auto" for the fastest that works on this machine.

    Where gsplat's kernels have not been built yet, "cuda", and "auto" on a machine with a GPU and gsplat, builds them.

    Where that fails "auto" falls back to the CPU with a :class:`FallbackWarning`.

    Raises :class:`BackendError` where the name is unknown or the back end cannot run here.
    """
    if name not in _BACK_ENDS:
        raise BackendError(f"there is no rasterizer called {name!r}; use one of: {', '.join(_BACK_ENDS)}")
    return _BACK_ENDS[name]()


def _automatic() -> Rasterizer:
    if has_gpu() and importlib.util.find_spec("gsplat") is not None and _gsplat_works():
        return _cuda()
    return host_rasterizer()


@functools.cache
def _gsplat_works() -> bool:
    """Whether its kernels are there, after building them if need be; warns once, since builds that fail take minutes
    too."""
    try:
        _cuda()
    except BackendError as error:
        sentence = f"the CPU draws, since {error}; --device cuda insists on the GPU"
        warnings.warn(FallbackWarning(sentence), stacklevel=3)
        return False
    return True


def host_rasterizer() -> Rasterizer:
    """The fastest on the CPU, for work of seconds whose results go into files there."""
    try:
        return _cpu()
    except BackendError:
        return _reference()


def _cpu() -> Rasterizer:
    try:
        kernels = importlib.import_module("ringlight._kernels")
    except ImportError as error:
        remedy = "build it again with 'make setup', or install ringlight again"
        raise BackendError(f"the compiled module ringlight._kernels cannot be loaded ({error}); {remedy}") from error
    try:
        kernels.isa()
    except RuntimeError as error:
        raise BackendError(str(error)) from error
    from ringlight.rasterize.cpu import CpuRasterizer

    return CpuRasterizer()


def _reference() -> Rasterizer:
    from ringlight.rasterize.reference import ReferenceRasterizer

    return ReferenceRasterizer()


def refuse_without_gpu(name: str) -> None:
    """Raises :class:`BackendError` where this back end needs a GPU that is not there. Builds nothing."""
    if name == "cuda" and not has_gpu():
        raise BackendError(
            "torch finds no NVIDIA GPU on this machine; use --device cpu, or let 'ringlight doctor' say what is missing"
        )


def _cuda() -> Rasterizer:
    refuse_without_gpu("cuda")
    from ringlight.rasterize.cuda import CudaRasterizer
    from ringlight.rasterize.gsplat_build import compiled_gsplat
    from ringlight.rasterize.gsplat_seam import Gsplat

    return CudaRasterizer(Gsplat(compiled_gsplat()))


def has_gpu() -> bool:
    """Whether torch can use an NVIDIA GPU."""
    import torch

    return torch.cuda.is_available()


_BACK_ENDS: dict[str, Callable[[], Rasterizer]] = {
    "auto": _automatic,
    "cpu": _cpu,
    "reference": _reference,
    "cuda": _cuda,
}
