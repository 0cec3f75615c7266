"""From the name a user gave to a back end, or to the sentence that says why there is none."""

import importlib
from collections.abc import Callable

from ringlight.errors import BackendError
from ringlight.rasterize.contract import Rasterizer


def rasterizer_for(name: str = "auto") -> Rasterizer:
    """The back end called ``name``: "cpu", "reference", or "auto" for the fastest that works on this machine.

    Raises :class:`BackendError` where the name is unknown or the back end cannot run here.
    """
    if name not in _BACK_ENDS:
        raise BackendError(f"there is no rasterizer called {name!r}; use one of: {', '.join(_BACK_ENDS)}")
    return _BACK_ENDS[name]()


def _automatic() -> Rasterizer:
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


def _cuda() -> Rasterizer:
    raise BackendError("this version of ringlight has no CUDA back end yet; use --device cpu")


_BACK_ENDS: dict[str, Callable[[], Rasterizer]] = {
    "auto": _automatic,
    "cpu": _cpu,
    "reference": _reference,
    "cuda": _cuda,
}
