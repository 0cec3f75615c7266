"""Adam's kernel and its reference are torch's Adam, on many parameters at once, in all rows or in those drawn."""

import pytest
import torch

from ringlight import _kernels
from ringlight.fit.adam import Update, adam_, adam_reference_

BETAS, EPSILON = (0.9, 0.999), 1e-15
ROWS = 3001
SHAPES = ((ROWS, 3), (ROWS,), (ROWS, 15, 3), (ROWS, 4))


def parameters(seed: int) -> list[torch.Tensor]:
    draw = torch.Generator().manual_seed(seed)
    return [torch.randn(shape, generator=draw) for shape in SHAPES]


def updates(values, gradients, moments, number: int = 1) -> list[Update]:
    rates = (0.01, 0.02, 0.005, 0.01)
    return [
        Update(*arrays, (rate, *BETAS, EPSILON, number))
        for *arrays, rate in zip(values, gradients, *moments, rates, strict=True)
    ]


def zeros() -> tuple[list[torch.Tensor], list[torch.Tensor]]:
    return [torch.zeros(shape) for shape in SHAPES], [torch.zeros(shape) for shape in SHAPES]


def some_radii(rows: int) -> torch.Tensor:
    """Runs of drawn and of undrawn rows of many lengths."""
    lengths = torch.randint(1, 40, (rows,), generator=torch.Generator().manual_seed(5))
    drawn = (torch.arange(rows) % 2).bool().repeat_interleave(lengths)[:rows]
    return torch.where(drawn[:, None], 2.0, 0.0).repeat(1, 2)


def test_kernel_and_reference_equal_torch():
    ours, references, torchs = parameters(0), parameters(0), [p.requires_grad_() for p in parameters(0)]
    moments, reference_moments = zeros(), zeros()
    judge = torch.optim.Adam(
        [{"params": [p], "lr": u.step[0]} for p, u in zip(torchs, updates(ours, ours, moments), strict=True)],
        betas=BETAS,
        eps=EPSILON,
    )
    for number in range(1, 6):
        gradients = parameters(number)
        adam_(updates(ours, gradients, moments, number))
        for update in updates(references, gradients, reference_moments, number):
            adam_reference_(update)
        for parameter, gradient in zip(torchs, gradients, strict=True):
            parameter.grad = gradient
        judge.step()
    for value, reference, expected in zip(ours, references, torchs, strict=True):
        torch.testing.assert_close(value, expected.detach(), rtol=0, atol=1e-6)
        torch.testing.assert_close(reference, expected.detach(), rtol=0, atol=1e-6)


def test_only_drawn_rows_move_in_kernel_and_reference():
    radii = some_radii(ROWS)
    drawn = radii[:, 0] > 0
    assert 0 < int(drawn.sum()) < ROWS
    start, gradients, whole = parameters(0), parameters(1), parameters(0)
    ours, references, moments, reference_moments = parameters(0), parameters(0), zeros(), zeros()
    adam_(updates(ours, gradients, moments), radii)
    adam_(updates(whole, gradients, zeros()))
    for update in updates(references, gradients, reference_moments):
        adam_reference_(update, radii)
    for index, value in enumerate(ours):
        assert torch.equal(value[drawn], whole[index][drawn])
        assert torch.equal(value[~drawn], start[index][~drawn])
        assert not moments[0][index][~drawn].any()
        assert not moments[1][index][~drawn].any()
        torch.testing.assert_close(value, references[index], rtol=0, atol=1e-6)
        torch.testing.assert_close(moments[1][index], reference_moments[1][index], rtol=1e-4, atol=1e-9)


@pytest.mark.parametrize("radii", [None, some_radii(ROWS)])
def test_any_number_of_threads_gives_the_same_bits(radii):
    ends = []
    try:
        for threads in (1, 2, 4):
            _kernels.set_threads(threads)
            values, moments = parameters(0), zeros()
            adam_(updates(values, parameters(1), moments), radii)
            ends.append([*values, *moments[0], *moments[1]])
    finally:
        _kernels.set_threads(0)
    for end in ends[1:]:
        assert all(torch.equal(first, other) for first, other in zip(ends[0], end, strict=True))


def test_other_types_take_the_reference_and_gradients_may_be_strided():
    double, single = torch.ones(4, 3, dtype=torch.float64), torch.ones(4, 3)
    gradient = torch.arange(12.0).view(3, 4).T
    pair = [
        Update(value, gradient.to(value), torch.zeros_like(value), torch.zeros_like(value), (0.5, *BETAS, EPSILON, 1))
        for value in (double, single)
    ]
    adam_(pair)
    torch.testing.assert_close(double.float(), single, rtol=1e-5, atol=1e-6)
    assert (single[1:] < 0.6).all()


def test_radii_of_another_table_are_refused():
    with pytest.raises(ValueError, match="as many rows as radii"):
        adam_(updates(parameters(0), parameters(1), zeros()), torch.ones(7, 2))


def test_a_graph_that_needs_the_old_value_notices():
    value = torch.ones(3, requires_grad=True)
    later = (value * value).sum()
    with torch.no_grad():
        adam_([Update(value, torch.ones(3), torch.zeros(3), torch.zeros(3), (0.1, *BETAS, EPSILON, 1))])
    with pytest.raises(RuntimeError, match="modified by an inplace operation"):
        later.backward()


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), -float("inf"), 1e30])
@pytest.mark.parametrize("with_radii", [False, True])
def test_elements_that_would_not_be_finite_stay_and_are_counted_in_kernel_and_reference(bad: float, with_radii: bool):
    """A gradient of 1e30 is finite, its square is not."""
    values, references, gradients = parameters(0), parameters(0), parameters(1)
    moments, reference_moments = zeros(), zeros()
    radii = some_radii(ROWS) if with_radii else None
    drawn = radii[:, 0] > 0 if radii is not None else torch.ones(ROWS, dtype=torch.bool)
    rows = drawn.nonzero()[:, 0][[0, 20, -1]]
    for gradient in gradients:
        gradient.view(ROWS, -1)[rows, -1] = bad
    kept = adam_(updates(values, gradients, moments), radii)
    assert kept == len(rows) * len(SHAPES)
    assert sum(adam_reference_(update, radii) for update in updates(references, gradients, reference_moments)) == kept
    for value, reference, before, mean, square in zip(values, references, parameters(0), *moments, strict=True):
        torch.testing.assert_close(value, reference, rtol=0, atol=1e-6)
        stayed = (value == before).view(ROWS, -1)
        assert stayed[rows, -1].all()
        assert not stayed[drawn].all(), "the others moved"
        assert mean.isfinite().all()
        assert square.isfinite().all()
        assert (mean.view(ROWS, -1)[rows, -1] == 0).all()
