"""What a caller wants of a picture. It is said in the call; nothing depends on ``torch.no_grad()``."""

from enum import Enum


class Want(Enum):
    """``GRADIENTS`` and ``EXACT`` give the same bits."""

    GRADIENTS = "gradients"
    """The exact picture, as a record that knows its way back."""
    EXACT = "exact"
    """The exact picture alone."""
    PICTURE = "picture"
    """A fast picture: the last 1/64 of a pixel's light may be taken for what lies in front of it, with alpha 1, and
    networks may round as a byte does."""
