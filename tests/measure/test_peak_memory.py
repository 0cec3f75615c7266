"""The peak of a stretch is counted from its start, and not told where the system does not know it."""

import sys
from pathlib import Path

import numpy as np
import pytest

from ringlight.measure import peak_memory
from ringlight.measure.peak_memory import PeakMemory

LARGE, SMALL = 300_000_000, 20_000_000
"""Bytes; the second is more than what Python does beside it."""

on_linux = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")


def resettable() -> bool:
    """Whether this system lets a process set its peak back; containers may not."""
    try:
        peak_memory.CLEAR.write_text(peak_memory.RESET_PEAK)
    except OSError:
        return False
    return True


@pytest.mark.skipif(not resettable(), reason="the peak cannot be set back here")
def test_what_was_freed_counts_and_what_was_there_before_does_not():
    kept = np.ones(LARGE // 8)
    np.ones(LARGE // 4)  # a peak before the start
    peak = PeakMemory()
    np.ones(LARGE // 8)
    growth = peak.growth()
    assert growth is not None
    assert abs(growth - LARGE) < SMALL
    assert kept.sum() == LARGE // 8


@on_linux
def test_the_larger_of_two_stretches():
    peak = PeakMemory(earlier=LARGE)
    np.ones(SMALL // 8)
    assert peak.growth() == LARGE


def test_a_stretch_before_that_is_not_known_leaves_the_whole_unknown():
    assert PeakMemory(earlier=None).growth() is None


def test_where_the_system_says_nothing_what_was_known_is_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setattr(peak_memory, "STATUS", tmp_path / "status")
    assert PeakMemory(earlier=LARGE).growth() == LARGE


def test_where_the_system_says_nothing_nothing_is_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setattr(peak_memory, "STATUS", tmp_path / "status")
    assert PeakMemory().growth() is None


@on_linux
def test_a_peak_before_the_start_is_not_ours(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    """Where the count cannot be set back."""
    monkeypatch.setattr(peak_memory, "CLEAR", tmp_path / "none" / "clear_refs")
    status = tmp_path / "status"
    monkeypatch.setattr(peak_memory, "STATUS", status)
    status.write_text("VmHWM:\t 900 kB\nVmRSS:\t 400 kB\n")
    peak = PeakMemory()
    assert peak.growth() is None
    status.write_text("VmHWM:\t 901 kB\nVmRSS:\t 500 kB\n")
    assert peak.growth() == 501 * 1024
