"""How many Gaussians, or whatever a model grows, a machine has memory for while it trains."""

import torch

from ringlight.core.memory import machine_memory
from ringlight.models.contract import Model

SHARE = 0.5
"""Of the machine's memory for Gaussians; photographs, their float forms and the system share the rest."""

COPIES = 5
"""Of a row while it trains: value, gradient, two moments, and one while density control builds a new table."""

GOOD_COPIES = 4
"""And where a guard keeps an earlier state: value, two moments, and the mean of models where one had begun. The
training's own mean lies where density control, which is over by then, built its tables."""

WORK_BYTES = 400
"""A Gaussian in the rasterizer's workspace, measured: 350 at 800 x 800 pixels."""


def most_rows(model: Model, memory: int | None = None, guarded: bool = False) -> int:
    """As many as fit into their share of ``memory`` bytes, by default this machine's, or its GPU's if that draws.

    A ``guarded`` training keeps an earlier state besides (fit/guard.py).
    """
    memory = memory_of(model.device) if memory is None else memory
    copies = COPIES + (GOOD_COPIES if guarded else 0)
    return max(int(SHARE * memory) // (copies * model.bytes_each() + WORK_BYTES), 1)


def memory_of(device: torch.device) -> int:
    """Bytes that there are for what lies on a device."""
    return torch.cuda.get_device_properties(device).total_memory if device.type == "cuda" else machine_memory()
