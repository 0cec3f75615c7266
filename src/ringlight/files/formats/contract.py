"""The socket: a model as a file that other programs open. Torch-free: the command line lists what can be written."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, runtime_checkable

if TYPE_CHECKING:
    from torch import Tensor


class Form(Enum):
    """What a writer takes of a model; the words complete "it holds ..."."""

    EXACT_HARMONICS = "exact harmonics"
    """Columns of Gaussians, "sh_dc" and "sh_rest" among them, that show what the model shows."""
    HARMONICS = "Gaussians"
    """The same columns; a model without exact harmonics gets some that are fitted to its pictures."""
    OWN = "tensors"
    """The tensors that rendering needs, under the model's own names."""


@dataclass(frozen=True)
class Content:
    """A model in the form that was asked for: tensors by name. ``antialiased``: how the model was trained to be drawn;
    ``comments`` say where it comes from."""

    tensors: "Mapping[str, Tensor]"
    antialiased: bool
    comments: tuple[str, ...]


@runtime_checkable
class Writer(Protocol):
    """One format; its place in the table says the suffix."""

    form: Form
    about: str
    """What opens it, for the help."""

    def write(self, path: Path, content: Content) -> None:
        """Write all or nothing. Raises OutputError."""
        ...
