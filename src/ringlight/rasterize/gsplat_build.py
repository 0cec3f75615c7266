"""Gets gsplat's compiled kernels: found built, or built now, with a sentence where that cannot work."""

import contextlib
import importlib
import importlib.util
import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ringlight.errors import BackendError

OLDEST_GSPLAT = (1, 5, 3)

EXTENSION = "gsplat_cuda"
"""Under this name gsplat has torch build its kernels."""

JOB_BYTES = 3 << 30
"""One compiler of one CUDA file takes up to this; gsplat starts ten unless MAX_JOBS says otherwise."""

MOST_JOBS = 10

INSTALL = 'install it with: pip install "ringlight[cuda]"'
DIAGNOSIS = "'ringlight doctor' says what is missing; until then use --device cpu"


def compiled_gsplat() -> Any:
    """The package ``gsplat``, with kernels that can be called; builds them on the first call, which takes minutes.

    What gsplat shows while it builds goes to standard error. Raises BackendError where it is missing, too old, or
    cannot be built.
    """
    try:
        gsplat = importlib.import_module("gsplat")
    except Exception as error:  # whatever a damaged package raises
        reason = _first_line(error)
        raise BackendError(f"gsplat, which draws on the GPU, cannot be loaded ({reason}); {INSTALL}") from error
    number = version_of(gsplat.__version__)
    if number < OLDEST_GSPLAT:
        oldest = ".".join(map(str, OLDEST_GSPLAT))
        raise BackendError(f"gsplat {gsplat.__version__} is too old, {oldest} or newer is needed; {INSTALL}")
    with contextlib.redirect_stdout(sys.stderr), _few_enough_jobs():
        try:
            kernels = importlib.import_module("gsplat.cuda._backend")._C
        except Exception as error:  # whatever a compiler's failure raises: its own words follow
            raise BackendError(f"gsplat's kernels cannot be built ({_first_line(error)}); {DIAGNOSIS}") from error
    if kernels is None:
        raise BackendError(f"gsplat found no CUDA toolkit to build its kernels with; {DIAGNOSIS}")
    return gsplat


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]


def version_of(text: str) -> tuple[int, ...]:
    """The leading numbers: (1, 5, 3) of "1.5.3+pt24cu124"."""
    return tuple(int(part) for part in re.match(r"[\d.]*", text)[0].split(".") if part)  # type: ignore[index]


def is_built() -> bool:
    """Whether kernels are there, so that nothing needs a compiler. Looks at files only; builds nothing."""
    # To look into the package imports it, which a damaged one does not survive; whoever needs it will say so.
    with contextlib.suppress(Exception):
        if importlib.util.find_spec("gsplat.csrc") is not None:
            return True
    return any((folder / f"{EXTENSION}.so").is_file() for folder in _build_folders())


def safe_jobs() -> int:
    """Compilers that fit into the memory that is free now."""
    return max(1, min(MOST_JOBS, os.cpu_count() or 1, free_memory() // JOB_BYTES))


def free_memory() -> int:
    """Bytes that programs may still have, by Linux's own estimate; elsewhere enough for one compiler."""
    try:
        found = re.search(r"MemAvailable:\s*(\d+) kB", Path("/proc/meminfo").read_text())
    except OSError:
        found = None
    return int(found[1]) * 1024 if found else JOB_BYTES


def _build_folders() -> Iterator[Path]:
    """Where torch puts what it builds; ``TORCH_EXTENSIONS_DIR`` or the user's cache, a folder for each version."""
    named = os.environ.get("TORCH_EXTENSIONS_DIR")
    root = Path(named) if named else Path.home() / ".cache" / "torch_extensions"
    yield from (root / EXTENSION, *root.glob(f"*/{EXTENSION}"))


@contextlib.contextmanager
def _few_enough_jobs() -> Iterator[None]:
    """MAX_JOBS for gsplat's build, unless somebody has set it."""
    if "MAX_JOBS" in os.environ:
        yield
        return
    os.environ["MAX_JOBS"] = str(safe_jobs())
    try:
        yield
    finally:
        os.environ.pop("MAX_JOBS", None)
