"""Shapes are checked during tests only.

``RINGLIGHT_TESTS=unchecked`` leaves the checks out, for tests that run once more with another instruction set.
"""

import importlib
import importlib.util
import os
import signal
import sys
from collections.abc import Iterator

import pytest
from hypothesis import settings

os.environ.setdefault("OMP_WAIT_POLICY", "passive")

from checked_shapes import check_shapes_of

if os.environ.get("RINGLIGHT_TESTS") != "unchecked":
    check_shapes_of("ringlight")

# A shell's job in the background, or one under nohup: commands would ignore these signals too.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)

settings.register_profile("untimed", deadline=None)  # a loaded machine is no failure
settings.load_profile("untimed")


@pytest.fixture(autouse=True)
def _same_draws_in_any_order() -> None:
    """Of test functions that draw from torch's own generator; fixtures of a module have seeds of their own."""
    torch = sys.modules.get("torch")
    if torch is not None:
        torch.manual_seed(0)


@pytest.fixture
def all_cores_afterwards() -> Iterator[None]:
    """For tests that set the threads of kernels or torch."""
    import torch

    before = torch.get_num_threads()
    yield
    from ringlight import _kernels

    _kernels.set_threads(0)
    torch.set_num_threads(before)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files with slow tests come first, so that no worker waits for the other's at the end; tests marked ``cuda`` say
    why they do not run; Triton's kernels are left unchecked on a GPU."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)
    marked = [item for item in items if item.get_closest_marker("cuda")]
    torch = importlib.import_module("torch") if marked else sys.modules.get("torch")
    if torch is None or not torch.cuda.is_available():
        for item in marked:
            item.add_marker(pytest.mark.skip(reason="needs an NVIDIA GPU"))
        return
    # Kernels are loaded when a test first needs one, and Triton wants them without the checks of shapes.
    if importlib.util.find_spec("triton"):
        importlib.import_module("interpreted")
