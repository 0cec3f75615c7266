"""The socket: which batch each training step looks at."""

from typing import Protocol, runtime_checkable

from ringlight.core.batch import Batch


@runtime_checkable
class Batches(Protocol):
    """A pure function of (seed, step), and of what a strategy keeps in its state, so that a resumed run sees what it
    would have seen."""

    def at(self, step: int) -> Batch:
        """The batch of ``step`` (1 is the first)."""
        ...
