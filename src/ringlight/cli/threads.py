"""How many threads the kernels and torch use, and what the process does with memory."""

import sys

from ringlight.core.cores import usable_cores
from ringlight.core.words import counted
from ringlight.errors import BackendError, RecipeError

MOST_THREADS = 1024
"""More than machines have cores. A million threads are begun, and take ten times as long."""

TORCH_THREADS = 1
"""torch cuts long arrays into a part for each of its threads, and rounds the last numbers of a part otherwise (sigmoid)
or adds the parts up (mean): with more than one, bits would depend on ``--threads``. Its share is small, but for
products of tensor trains, which ``core/shared_pieces.py`` shares out."""


def check_threads(count: int, jobs: int = 1) -> None:
    """Says on standard error where ``jobs`` runs side by side want more threads than there are cores; 0 jobs are done
    elsewhere. Nothing is loaded for it.

    Raises RecipeError for fewer threads than none, or more than MOST_THREADS.
    """
    if not 0 <= count <= MOST_THREADS:
        raise RecipeError(f"--threads is {count}; give a number of threads up to {MOST_THREADS}, or 0 for every core")
    cores = usable_cores()
    if count * jobs > cores:
        asked = f"{count} for each of {jobs} runs side by side," if jobs > 1 else f"{count}"
        sys.stderr.write(
            f"warning: --threads is {asked} and this process has {counted(cores, 'core')}, on which threads take "
            "turns; --threads 0 shares the cores out\n"
        )


def use_threads(count: int) -> None:
    """``count`` threads for the kernels, 0 for every core, and one for torch; freed arrays are kept for the next step.

    Raises BackendError where the kernels cannot run: every command that calls this needs them, whatever the rasterizer.
    """
    import torch

    try:
        from ringlight import _kernels

        _kernels.isa()
    except ImportError as error:
        raise BackendError(f"the compiled module cannot be loaded ({error}); see 'ringlight doctor'") from error
    except RuntimeError as error:
        raise BackendError(str(error)) from error
    _kernels.set_threads(count)
    _kernels.keep_freed_memory()
    torch.set_num_threads(TORCH_THREADS)
