"""How many threads the kernels and torch use, and what the process does with memory."""

from ringlight.errors import BackendError, RecipeError

MOST_TORCH_THREADS = 2
"""torch only builds small tables: more threads wait for each other longer than they work."""


def use_threads(count: int) -> None:
    """``count`` threads for the kernels, 0 for every core; arrays that a step frees are kept for the next.

    Raises RecipeError for fewer than none, BackendError where the kernels cannot run: every command that calls this
    needs them, whatever the rasterizer.
    """
    if count < 0:
        raise RecipeError(f"--threads is {count}; give a number of threads, or 0 for every core")
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
    torch.set_num_threads(min(_kernels.threads(), MOST_TORCH_THREADS))
