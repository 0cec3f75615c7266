"""Numbers that break kernels, for hypothesis; and a watchdog, so that a kernel that hangs ends the run with a trace."""

import faulthandler
import os
from collections.abc import Iterator

import pytest
import torch
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from torch import Tensor

LARGEST = 3.4028234663852886e38
EDGES = [0.0, -0.0, 1.4e-45, 1.2e-38, 1e-30, 1e-20, 1e-6, 0.01, 1.0, 1e4, 1e8, 1e15, 1e19, 1e20, 1e30, 3e38, LARGEST]

PATIENCE = int(os.environ.get("RINGLIGHT_PATIENCE", "120"))
"""Seconds for all examples of one test, hundreds of times what they take on a busy machine; sanitizers need more."""

fuzzed = settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))


@pytest.fixture(autouse=True)
def watchdog() -> Iterator[None]:
    """Import it into a module of fuzz tests."""
    faulthandler.dump_traceback_later(PATIENCE, exit=True)
    yield
    faulthandler.cancel_dump_traceback_later()


def numbers(largest: float = LARGEST) -> st.SearchStrategy[float]:
    """Finite float32 up to ``largest`` in magnitude: ordinary ones, edges, and any other."""
    edges = [sign * edge for edge in EDGES if edge <= largest for sign in (1, -1)]
    bound = torch.tensor(largest).item()
    return st.one_of(st.floats(-3, 3, width=32), st.sampled_from(edges), st.floats(-bound, bound, width=32))


@st.composite
def tensors(draw: st.DrawFn, *shape: int, largest: float = LARGEST, spoiled: float = 0.5) -> Tensor:
    """Normal numbers; in about half of the draws up to a dozen of them are replaced by :func:`numbers`."""
    seed = draw(st.integers(0, 2**32 - 1))
    values = torch.randn(*shape, generator=torch.Generator().manual_seed(seed))
    if values.numel() == 0 or draw(st.floats(0, 1)) > spoiled:
        return values
    for _ in range(draw(st.integers(1, 12))):
        values.view(-1)[draw(st.integers(0, values.numel() - 1))] = draw(numbers(largest))
    return values


def assert_finite(**named: Tensor) -> None:
    for name, tensor in named.items():
        assert tensor.isfinite().all(), f"{name} holds {tensor[~tensor.isfinite()][0].item()}"
