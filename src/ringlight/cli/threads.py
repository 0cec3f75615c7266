"""How many threads the kernels and torch use."""

from ringlight.errors import BackendError

MOST_TORCH_THREADS = 2
"""torch only builds small tables: more threads wait for each other longer than they work."""


def use_threads(count: int) -> None:
    """``count`` threads for the kernels, 0 for every core.

    Raises BackendError where the kernels cannot run: every command that calls this needs them, whatever the
    rasterizer.
    """
    import torch

    try:
        from ringlight import _kernels

        _kernels.isa()
    except ImportError as error:
        raise BackendError(f"the compiled module cannot be loaded ({error}); see 'ringlight doctor'") from error
    except RuntimeError as error:
        raise BackendError(str(error)) from error
    _kernels.set_threads(max(count, 0))
    torch.set_num_threads(min(_kernels.threads(), MOST_TORCH_THREADS))
