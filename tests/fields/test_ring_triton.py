"""The ring's Triton kernels against the reference, in value and gradient."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

import interpreted
from ringlight.core.directions import octahedral_from_directions
from ringlight.fields import ring_triton
from ringlight.fields.ring_tables import RingTables, ring_features
from ringlight.fields.ring_triton import ring_features_by_triton


@settings(max_examples=8, derandomize=True)
@given(
    count=st.integers(1, 37),
    nodes=st.integers(2, 9),
    side=st.integers(2, 6),
    rank=st.integers(1, 6),
    features=st.integers(1, 5),
)
def test_equals_the_reference(count: int, nodes: int, side: int, rank: int, features: int):
    check(count, nodes, side, rank, features)


def test_the_rank_of_the_presets():
    check(19, 5, 4, 16, 12)


def test_many_rows_come_in_chunks(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(ring_triton, "CHUNK", 7)
    check(19, 5, 4, 3, 4)


def test_no_rows():
    axes, view, core = (torch.ones(shape, device=interpreted.DEVICE) for shape in ((3, 4, 9), (4, 9), (2, 9)))
    points, uv = (torch.zeros(0, width, device=interpreted.DEVICE) for width in (3, 2))
    nothing = ring_features_by_triton(points, uv, axes, view, core.requires_grad_())
    nothing.sum().backward()
    assert nothing.shape == (0, 2)
    assert (core.grad == 0).all()


def check(count: int, nodes: int, side: int, rank: int, features: int):
    generator = torch.Generator().manual_seed(count + nodes)
    draw = lambda *shape: torch.randn(*shape, generator=generator)  # noqa: E731
    points = draw(count, 3).clamp(-1.2, 1.2)
    points[0] = 1.0  # the last node itself
    directions = torch.nn.functional.normalize(draw(count, 3), dim=-1)
    uv = octahedral_from_directions(directions)
    tables = [draw(3, nodes, rank**2), draw(side**2, rank**2), draw(features, rank**2)]
    upstream = draw(count, features)

    exact = [table.double().requires_grad_() for table in tables]
    expected = ring_features(RingTables(*exact), points.double(), directions.double())
    expected.backward(upstream.double())
    ours = [table.to(interpreted.DEVICE).requires_grad_() for table in tables]
    found = ring_features_by_triton(points.to(interpreted.DEVICE), uv.to(interpreted.DEVICE), *ours)
    found.backward(upstream.to(interpreted.DEVICE))
    pairs = [(found, expected), *((mine.grad, truth.grad) for mine, truth in zip(ours, exact, strict=True))]
    for mine, truth in pairs:
        scale = truth.abs().max().item()
        torch.testing.assert_close(mine.cpu().double(), truth, rtol=0, atol=2e-5 * max(scale, 1e-6))
