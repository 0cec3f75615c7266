"""Settings that came after files were written: where a file lacks one it means what there was before. Torch-free."""

from dataclasses import Field, field
from typing import Any

LATER = "later"
"""Key of a field's metadata."""


UNSTATED = object()
"""None can be a default."""


def later(before: Any, now: Any = UNSTATED) -> Any:
    """A dataclass field; ``before`` is what programs did that did not know the setting, and the default unless ``now``
    states another."""
    return field(default=before if now is UNSTATED else now, metadata={LATER: before})


def came_later(setting: "Field[Any]") -> bool:
    """Whether a file may lack it."""
    return LATER in setting.metadata


def value_before(setting: "Field[Any]") -> Any:
    """What a file means that lacks it."""
    return setting.metadata[LATER]
