"""Harmonics of a lower degree that look most alike: the least squares that they are said to be, row by row."""

import pytest
import torch

from ringlight import _kernels
from ringlight.core.camera import Camera
from ringlight.core.directions import view_directions
from ringlight.core.sh_basis import basis_count, sh_basis
from ringlight.fit.narrowed_harmonics import RIDGE, narrowed_harmonics


def cameras(count: int, above: bool) -> list[Camera]:
    """Around the origin, at three units; ``above`` all of them on one side of it, as photographers stand."""
    drawn = torch.Generator().manual_seed(5)
    positions = torch.nn.functional.normalize(torch.randn(count, 3, generator=drawn), dim=-1) * 3
    if above:
        positions[:, 2] = positions[:, 2].abs()
    found = []
    for position in positions:
        matrix = torch.eye(4)
        matrix[:3, 3] = -position
        found.append(Camera(matrix, (50.0, 50.0), (10.0, 10.0), 20, 20))
    return found


def table(count: int, stored: int = 15) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    drawn = torch.Generator().manual_seed(count)
    return tuple(torch.randn(*shape, generator=drawn) for shape in ((count, 3), (count, 3), (count, stored, 3)))  # type: ignore[return-value]


def errors(
    means: torch.Tensor, dc: torch.Tensor, rest: torch.Tensor, truth: torch.Tensor, looks: list[Camera]
) -> float:
    """Mean squared difference of colours, before they are clamped, towards all cameras."""
    total = 0.0
    for camera in looks:
        basis = sh_basis(view_directions(means, camera.position), 3)
        whole = torch.cat([dc[:, None], rest], 1)
        total += float(torch.einsum("nk,nkc->nc", basis, whole - truth).square().mean())
    return total / len(looks)


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_it_is_the_least_squares_fit(degree: int):
    means, dc, rest = (values.double() for values in table(7))
    looks, kept = cameras(40, above=True), basis_count(degree)
    found_dc, found_rest = narrowed_harmonics(means.float(), dc.float(), rest.float(), degree, looks)
    assert not found_rest[:, kept - 1 :].any()
    for row in range(7):
        basis = torch.cat([sh_basis(view_directions(means[row : row + 1], c.position.double()), 3) for c in looks])
        ridge = (RIDGE * len(looks)) ** 0.5 * torch.eye(kept, dtype=torch.float64)
        seen = basis[:, kept:] @ rest[row, kept - 1 :]
        target = torch.cat([seen, torch.zeros(kept, 3, dtype=torch.float64)])
        added = torch.linalg.lstsq(torch.cat([basis[:, :kept], ridge]), target).solution
        expected = torch.cat([dc[row : row + 1], rest[row, : kept - 1]]) + added
        found = torch.cat([found_dc[row : row + 1], found_rest[row, : kept - 1]]).double()
        torch.testing.assert_close(found, expected, atol=1e-4, rtol=1e-4)


def test_from_one_side_it_looks_much_more_alike_than_cut_harmonics():
    means, dc, rest = table(50)
    means = 0.2 * means
    truth, looks, others = torch.cat([dc[:, None], rest], 1), cameras(60, above=True), cameras(45, above=True)
    cut = rest.clone()
    cut[:, 8:] = 0
    fitted = narrowed_harmonics(means, dc, rest, 2, looks)
    assert errors(means, *fitted, truth, looks) < 0.5 * errors(means, dc, cut, truth, looks)
    assert errors(means, *fitted, truth, others) < 0.7 * errors(means, dc, cut, truth, others), (
        "cameras it has not seen"
    )


def test_harmonics_that_are_of_the_degree_already_stay():
    means, dc, rest = table(20)
    rest[:, 8:] = 0
    found_dc, found_rest = narrowed_harmonics(means, dc, rest, 2, cameras(30, above=True))
    assert torch.equal(found_dc, dc)
    assert torch.equal(found_rest, rest)
    means, dc, rest = table(20, stored=3)
    assert torch.equal(narrowed_harmonics(means, dc, rest, 2, cameras(3, above=True))[1], rest)


def test_neither_threads_nor_the_order_of_rows_change_a_bit():
    means, dc, rest = table(400)
    looks, order = cameras(5, above=True), torch.randperm(400, generator=torch.Generator().manual_seed(1))
    threads, results = torch.get_num_threads(), []
    for count in (1, 2, 4):
        torch.set_num_threads(count)
        _kernels.set_threads(count)
        results.append(narrowed_harmonics(means, dc, rest, 2, looks))
    torch.set_num_threads(threads)
    _kernels.set_threads(0)
    results.append(
        tuple(values[order.argsort()] for values in narrowed_harmonics(means[order], dc[order], rest[order], 2, looks))
    )  # type: ignore[arg-type]
    for other in results[1:]:
        assert all(torch.equal(a, b) for a, b in zip(results[0], other, strict=True))
