"""How many Gaussians, or whatever a model grows, a machine has memory for while it trains."""

import torch

from ringlight.core.memory import machine_memory
from ringlight.models.contract import Model

SHARE = 0.5
"""Of the machine's memory for Gaussians; photographs, their float forms and the system share the rest."""

COPIES = 5
"""Of a row while it trains: value, gradient, two moments, and one while density control builds a new table."""

WORK_BYTES = 400
"""A Gaussian in the rasterizer's workspace, measured: 350 at 800 x 800 pixels."""


def most_rows(model: Model, memory: int | None = None) -> int:
    """As many as fit into their share of ``memory`` bytes, by default this machine's, or its GPU's if that draws."""
    if memory is None:
        on_gpu = model.device.type == "cuda"
        memory = torch.cuda.get_device_properties(model.device).total_memory if on_gpu else machine_memory()
    return max(int(SHARE * memory) // (COPIES * model.bytes_each() + WORK_BYTES), 1)
