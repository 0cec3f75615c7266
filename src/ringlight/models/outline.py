"""Models of shapes alone: what a file must hold is asked of one, before memory is allocated."""

from torch import nn


def is_outline(model: nn.Module) -> bool:
    """Whether it was built, at least in part, on torch's meta device: there are no numbers that could be moved."""
    return any(tensor.is_meta for tensor in (*model.parameters(), *model.buffers()))
