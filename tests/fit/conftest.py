"""Tests of training steps, which start from any surface."""

import pytest

from ringlight.data import hull

CELLS = 32
"""Voxels along a subject's longest side: the usual 160 took most of the time of a run of a few steps."""


@pytest.fixture(autouse=True)
def _coarse_hulls(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hull, "FINE_CELLS", CELLS)
