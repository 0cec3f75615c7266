"""Settings that came after files were written: where a file lacks one it means what there was before. Torch-free."""

from dataclasses import Field, field
from typing import Any

LATER = "later"
"""Key of a field's metadata."""


def later(before: Any) -> Any:
    """A dataclass field whose default, ``before``, is what programs did that did not know the setting."""
    return field(default=before, metadata={LATER: True})


def came_later(setting: "Field[Any]") -> bool:
    """Whether a file may lack it."""
    return LATER in setting.metadata
