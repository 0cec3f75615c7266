"""Raw sizes count every real number at 32 bit, however it is stored, so that methods compare."""

from jaxtyping import Shaped
from torch import Tensor

FLOAT_BYTES = 4


def raw_bytes(tensor: Shaped[Tensor, "..."]) -> int:
    """Bytes of a tensor: 4 an element if these are real numbers, else as stored."""
    return tensor.numel() * (FLOAT_BYTES if tensor.is_floating_point() else tensor.element_size())
