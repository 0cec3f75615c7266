"""How many processor cores there are for this process. Imports no torch."""

import os


def usable_cores() -> int:
    """Of this process: containers and taskset give one fewer cores than the machine has."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
