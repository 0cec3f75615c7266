"""How many threads the kernels and torch use."""

MOST_TORCH_THREADS = 2
"""torch only builds small tables: more threads wait for each other longer than they work."""


def use_threads(count: int) -> None:
    """``count`` threads for the kernels, 0 for every core. Without kernels there is only torch to tell."""
    import torch

    try:
        from ringlight import _kernels
    except ImportError:
        torch.set_num_threads(count or MOST_TORCH_THREADS)
        return
    _kernels.set_threads(max(count, 0))
    torch.set_num_threads(min(_kernels.threads(), MOST_TORCH_THREADS))
