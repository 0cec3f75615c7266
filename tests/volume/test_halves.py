"""Products by pieces are torch's, both ways, and have the same bits for any number of threads."""

import pytest
import torch

from ringlight import _kernels
from ringlight.volume.halves import PIECE, product


def drawn(*shape: int, dtype: torch.dtype = torch.float64) -> torch.Tensor:
    found = torch.randn(shape, generator=torch.Generator().manual_seed(sum(shape)), dtype=torch.float64)
    return found.to(dtype).requires_grad_()


@pytest.mark.parametrize("count", [0, 1, 40, PIECE, PIECE + 1, 3 * PIECE - 5])
@pytest.mark.parametrize("columns", [1, 30, PIECE + 3])
def test_they_are_torchs_products(count: int, columns: int):
    rows, matrix = drawn(count, 24), drawn(24, columns)
    weights = drawn(count, columns).detach()
    ours, theirs = product(rows, matrix), rows @ matrix
    torch.testing.assert_close(ours, theirs)
    for one, other in zip(
        torch.autograd.grad((ours * weights).sum(), [rows, matrix]),
        torch.autograd.grad((theirs * weights).sum(), [rows, matrix]),
        strict=True,
    ):
        torch.testing.assert_close(one, other)


@pytest.mark.parametrize("wanted", [0, 1])
def test_only_the_gradient_that_is_wanted_is_made(wanted: int):
    pair = [drawn(700, 8).detach(), drawn(8, 700).detach()]
    pair[wanted].requires_grad_()
    product(*pair).sum().backward()
    assert [part.grad is not None for part in pair] == [wanted == 0, wanted == 1]


@pytest.mark.usefixtures("all_cores_afterwards")
@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
def test_bits_are_the_same_for_any_number_of_threads(dtype: torch.dtype):
    rows, matrix = drawn(1500, 70, dtype=dtype), drawn(70, 1300, dtype=dtype)
    weights = drawn(1500, 1300, dtype=dtype).detach()
    states = []
    for threads in (1, 2, 4):
        _kernels.set_threads(threads)
        found = product(rows, matrix)
        states.append([found, *torch.autograd.grad(found, [rows, matrix], weights)])
    for others in states[1:]:
        assert all(torch.equal(one, other) for one, other in zip(states[0], others, strict=True))
