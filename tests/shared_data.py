"""Where the scenes and oracles that may not be shipped lie; tests that need them skip where they are missing."""

import os
from pathlib import Path

import pytest

SHARED = Path(os.environ.get("RINGLIGHT_SHARED", Path(__file__).parents[2] / "shared"))


def shared(path: str) -> Path:
    """The file or folder below the shared data, or skip the calling test."""
    found = SHARED / path
    if not found.exists():
        pytest.skip(f"needs {path} of the shared data, which is not on this machine")
    return found
