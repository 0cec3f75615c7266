"""Noise on centres: in the covariance's shape, for faint Gaussians, and for no others."""

import pytest
import torch

from ringlight.core.gaussians import Gaussians
from ringlight.core.randomness import generator
from ringlight.fit.strategies.wander import turned, wander_

DEAD, SIZE = 0.005, 30.0


def table_of(opacities: torch.Tensor) -> Gaussians:
    rows = len(opacities)
    return Gaussians(
        torch.zeros(rows, 3),
        torch.tensor([0.3, 0.1, 0.02]).log().repeat(rows, 1),
        torch.tensor([0.9, -0.6, 1.3, 0.4]).repeat(rows, 1),  # of a length that is not one
        opacities.logit(),
    )


def test_a_vector_is_turned_as_by_the_rotation_matrix():
    drawn = torch.Generator().manual_seed(5)
    vectors, quats = torch.randn(50, 3, generator=drawn), torch.randn(50, 4, generator=drawn)
    rotations = Gaussians(vectors, vectors, quats, vectors[:, 0]).rotations
    assert torch.allclose(turned(vectors, quats), (rotations @ vectors[..., None])[..., 0], atol=1e-5)


@pytest.mark.parametrize("opacity", [0.002, DEAD, 0.02])
def test_its_distribution_is_that_of_the_covariance_times_normal_numbers(opacity: float):
    """Equation 8: covariance C, gate s, size z; the displacement's own covariance is (z s)^2 C C."""
    table = table_of(torch.full((200_000,), opacity))
    wander_(table, SIZE, DEAD, generator(1, 2, "test"))
    found = table.means.double().T @ table.means.double() / len(table)
    rotation = table.rotations[0].double()
    covariance = rotation @ table.scales[0].double().square().diag() @ rotation.T
    gate = 1 / (1 + torch.tensor(-100.0 * (DEAD - opacity)).double().exp())
    expected = (SIZE * gate) ** 2 * covariance @ covariance
    # The variance of a mean of n products of normal numbers is at most 2 / n of their variances' product.
    tolerance = 5 * (2 / len(table)) ** 0.5 * (expected.diag()[:, None] * expected.diag()).sqrt()
    assert ((found - expected).abs() <= tolerance + 1e-12).all()
    assert (table.means.mean(0).abs() <= 5 * (expected.diag() / len(table)).sqrt()).all()


def test_opaque_ones_stay_to_the_bit():
    table = table_of(torch.tensor([0.004, 0.9, 0.2, 0.01, 0.999]))
    table.means.copy_(torch.arange(15.0).view(5, 3))
    before = table.means.clone()
    wander_(table, SIZE, DEAD, generator(1, 2, "test"))
    assert ((table.means != before).any(1) == torch.tensor([True, False, False, True, False])).all()


def test_fainter_ones_go_farther():
    distances = []
    for opacity in (0.001, 0.005, 0.02, 0.06):
        table = table_of(torch.full((1000,), opacity))
        wander_(table, SIZE, DEAD, generator(1, 2, "test"))
        distances.append(table.means.norm(dim=1).mean().item())
    assert distances == sorted(distances, reverse=True)


@pytest.mark.parametrize(("size", "opacity"), [(0.0, 0.001), (SIZE, 0.5)])
def test_without_size_or_faint_ones_nothing_moves(size: float, opacity: float):
    table = table_of(torch.full((10,), opacity))
    wander_(table, size, DEAD, generator(1, 2, "test"))
    assert not table.means.any()
