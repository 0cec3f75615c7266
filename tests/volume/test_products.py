"""Products in pieces are torch's, both ways, and have the same bits for any number of threads."""

import pytest
import torch

from ringlight import _kernels
from ringlight.volume import products
from ringlight.volume.products import PIECE, product

EXACT, HALVED = {"rtol": 1e-9, "atol": 1e-9}, {"rtol": 2e-2, "atol": 0.3}
"""Of sums of up to 1,500 products of normal numbers; halves have seven bits."""


def drawn(*shape: int, dtype: torch.dtype = torch.float64) -> torch.Tensor:
    found = torch.randn(shape, generator=torch.Generator().manual_seed(sum(shape)), dtype=torch.float64)
    return found.to(dtype).requires_grad_()


@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float64, EXACT), (torch.bfloat16, HALVED)])
@pytest.mark.parametrize("count", [0, 1, 40, PIECE, PIECE + 1, 3 * PIECE - 5])
@pytest.mark.parametrize("columns", [1, 30, PIECE + 3])
def test_they_are_torchs_products(count: int, columns: int, dtype: torch.dtype, tolerance: dict[str, float]):
    rows, matrix = drawn(count, 24, dtype=dtype), drawn(24, columns, dtype=dtype)
    weights = drawn(count, columns, dtype=dtype).detach()
    ours, theirs = product(rows, matrix), rows.double() @ matrix.double()
    torch.testing.assert_close(ours.double(), theirs, **tolerance)
    for one, other in zip(
        torch.autograd.grad(ours, [rows, matrix], weights),
        torch.autograd.grad(theirs, [rows, matrix], weights.double()),
        strict=True,
    ):
        torch.testing.assert_close(one.double(), other.double(), **tolerance)


@pytest.mark.parametrize("device", ["cpu", "meta"])
def test_what_is_found_may_be_of_another_type(device: str):
    rows, matrix = (drawn(*shape, dtype=torch.bfloat16).to(device) for shape in ((PIECE + 9, 24), (24, 30)))
    rows, matrix = (factor.detach().requires_grad_() for factor in (rows, matrix))
    found = product(rows, matrix, torch.float32)
    assert found.dtype == torch.float32
    gradients = torch.autograd.grad(found, [rows, matrix], torch.ones_like(found))
    assert all(gradient.dtype == torch.bfloat16 for gradient in gradients)
    if device == "cpu":
        plain = product(rows, matrix)
        assert torch.equal(found, plain.float())
        of_plain = torch.autograd.grad(plain, [rows, matrix], torch.ones_like(plain))
        assert all(torch.equal(one, other) for one, other in zip(gradients, of_plain, strict=True))


@pytest.mark.parametrize(("wanted", "made"), [(0, ["by_rows"]), (1, ["by_columns"])])
def test_only_the_gradient_that_is_wanted_is_made(wanted: int, made: list[str], monkeypatch: pytest.MonkeyPatch):
    pair, calls = [drawn(700, 8).detach(), drawn(8, 700).detach()], []
    pair[wanted].requires_grad_()
    found = product(*pair)
    for name in ("by_rows", "by_columns"):
        whole = getattr(products, name)
        monkeypatch.setattr(products, name, lambda *of, name=name, whole=whole: (calls.append(name), whole(*of))[1])
    found.sum().backward()
    assert calls == made
    assert pair[wanted].grad is not None


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


def test_on_another_device_torch_multiplies():
    on_meta = product(torch.empty(5, 3, device="meta", requires_grad=True), torch.empty(3, 2, device="meta"))
    assert on_meta.shape == (5, 2)
    assert type(on_meta.grad_fn).__name__ == "MmBackward0"
