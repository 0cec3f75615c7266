"""What one training step looks at."""

from typing import Protocol, runtime_checkable


@runtime_checkable
class Batch(Protocol):
    """A photograph, a crop of one, or a lot of rays from several: whatever a model can predict and a loss compare."""

    @property
    def label(self) -> str:
        """What a message calls it: "view r_12"."""
        ...
