"""The shared basis's Triton kernels against the references, in value and gradient."""

import pytest
import torch
from torch import Tensor

import interpreted
from ringlight.color import shared_basis_triton
from ringlight.color.basis_opacities import LEAST_MEAN, factors_reference
from ringlight.color.harmonics import sh_colors_reference
from ringlight.color.shared_basis import mixed_harmonics
from ringlight.color.shared_basis_triton import BasisRows, MovedOpacities
from ringlight.core.sh_basis import sh_from_rgb

HARMONICS = 15


def drawn(count: int, size: int) -> dict[str, Tensor]:
    generator = torch.Generator().manual_seed(count + size)
    draw = lambda *shape: torch.randn(*shape, generator=generator)  # noqa: E731
    return {
        "means": draw(count, 3),
        "constants": draw(count, 3),
        "weights": 0.5 * draw(count, size),
        "basis": draw(size, HARMONICS, 3),
        "logits": 3 * draw(count),
        "moves": draw(size, HARMONICS),
    }


def expected_of(given: dict[str, Tensor], position: Tensor, degree: int, by_logits: bool) -> tuple[Tensor, Tensor]:
    constants = sh_from_rgb(given["constants"].sigmoid()) if by_logits else given["constants"]
    rest = mixed_harmonics(given["weights"], given["basis"])
    colors = sh_colors_reference(given["means"], constants, rest, position, degree)
    factors = factors_reference(
        given["means"], given["logits"], given["weights"], given["moves"], position, degree
    )  # fmt: skip
    return colors, factors


@pytest.mark.parametrize(("degree", "size", "count"), [(0, 2, 5), (1, 1, 70), (2, 5, 130), (3, 8, 200), (3, 16, 66)])
@pytest.mark.parametrize("by_logits", [False, True])
@pytest.mark.parametrize("moves", [False, True])
def test_equals_the_references(degree: int, size: int, count: int, by_logits: bool, moves: bool):
    given, position = drawn(count, size), torch.tensor([0.3, -0.2, 1.5])
    given["logits"][0] = -40  # fainter than the least mean
    upstream, by_factors = torch.randn(count, 5), torch.randn(count)
    exact = {name: tensor.double().requires_grad_() for name, tensor in given.items()}
    colors, factors = expected_of(exact, position.double(), degree, by_logits)
    outputs = (colors, factors) if moves else (colors,)
    arrived = (upstream[:, :3].double(), by_factors.double())[: len(outputs)]
    kept = {name: tensor for name, tensor in exact.items() if moves or name not in ("logits", "moves")}
    gradients = torch.autograd.grad(outputs, list(kept.values()), arrived, allow_unused=True)
    truth = dict(zip(kept, gradients, strict=True))

    rows = rows_of({name: given[name] for name in kept}, position, degree, by_logits)
    channels = torch.full((count, 5), 7.0, device=interpreted.DEVICE)
    found_factors = rows.emit(channels)
    found = rows.gradients(channels, upstream.to(interpreted.DEVICE), by_factors.to(interpreted.DEVICE))
    assert (channels[:, 3:] == 7).all(), "only the colour is written"
    assert size < 5 or (colors == 0).any(), "some are clamped"
    assert_near(channels[:, :3], colors, 1e-5)
    if moves:
        assert_near(found_factors, factors, 1e-5)
    for name in kept:
        wanted = torch.zeros_like(exact[name]) if truth[name] is None else truth[name]
        assert_near(getattr(found, name), wanted, 4e-5)


def test_programs_go_over_many_blocks(monkeypatch: pytest.MonkeyPatch):
    given, upstream, by_factors = drawn(200, 3), torch.randn(200, 3), torch.randn(200)
    found = []
    for programs in (shared_basis_triton.MOST_PROGRAMS, 2):
        monkeypatch.setattr(shared_basis_triton, "MOST_PROGRAMS", programs)
        rows = rows_of(given, torch.ones(3), degree=3)
        channels = torch.empty_like(rows.means)
        rows.emit(channels)
        found.append(rows.gradients(channels, upstream.to(interpreted.DEVICE), by_factors.to(interpreted.DEVICE)))
    for name in ("basis", "moves", "weights"):
        torch.testing.assert_close(getattr(found[0], name), getattr(found[1], name), rtol=1e-4, atol=1e-4)


def rows_of(given: dict[str, Tensor], position: Tensor, degree: int, by_logits: bool = False) -> BasisRows:
    there = {name: tensor.to(interpreted.DEVICE) for name, tensor in given.items()}
    opacities = MovedOpacities(there.pop("logits"), there.pop("moves"), LEAST_MEAN) if "moves" in there else None
    return BasisRows(**there, position=position, degree=degree, opacities=opacities, by_logits=by_logits)


def test_no_rows():
    rows = rows_of(drawn(0, 3), torch.zeros(3), degree=3)
    channels = rows.means.new_empty(0, 3)
    assert rows.emit(channels).shape == (0,)
    found = rows.gradients(channels, channels, None)
    assert (found.basis == 0).all()
    assert found.weights.shape == (0, 3)


def assert_near(mine: Tensor, truth: Tensor, tolerance: float) -> None:
    scale = truth.abs().max().item() if truth.numel() else 0.0
    # At degree 0 a factor's slopes cancel but for rounding.
    torch.testing.assert_close(mine.cpu().double(), truth.detach(), rtol=0, atol=tolerance * scale + 1e-6)
