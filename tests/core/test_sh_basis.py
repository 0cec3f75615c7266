"""The harmonics are orthonormal, equal scipy's up to the signs of the convention, and have 3DGS's order."""

import numpy as np
import pytest
import torch
from scipy.special import sph_harm_y

from ringlight.core.sh_basis import basis_count, rgb_from_sh, sh_basis, sh_from_rgb


def sphere_quadrature() -> tuple[torch.Tensor, torch.Tensor]:
    """Directions and weights that integrate polynomials up to degree 7 exactly: Gauss-Legendre by trapezoid."""
    heights, height_weights = np.polynomial.legendre.leggauss(6)
    azimuths = np.arange(12) * (2 * np.pi / 12)
    z, azimuth = (grid.ravel() for grid in np.meshgrid(heights, azimuths, indexing="ij"))
    across = np.sqrt(1 - z * z)
    directions = np.stack([across * np.cos(azimuth), across * np.sin(azimuth), z], -1)
    return torch.from_numpy(directions), torch.from_numpy(np.repeat(height_weights, 12) * (2 * np.pi / 12))


def test_orthonormal_under_quadrature():
    directions, weights = sphere_quadrature()
    basis = sh_basis(directions, 3)
    gram = basis.T @ (weights[:, None] * basis)
    torch.testing.assert_close(gram, torch.eye(16, dtype=gram.dtype), rtol=0, atol=1e-12)


def test_equals_scipy_in_order_and_sign():
    """Real harmonics from scipy's complex ones, which carry the same Condon-Shortley sign (-1)^m.

    The sine ones (m < 0) are those of +|m|: 3DGS keeps the sign of odd |m| for them too.
    """
    directions, _ = sphere_quadrature()
    x, y, z = directions.numpy().T
    polar, azimuth = np.arccos(z), np.arctan2(y, x)
    expected = []
    for degree in range(4):
        for order in range(-degree, degree + 1):
            value = sph_harm_y(degree, abs(order), polar, azimuth)
            part = value.imag if order < 0 else value.real
            expected.append(part * (1 if order == 0 else np.sqrt(2)))
    np.testing.assert_allclose(sh_basis(directions, 3).numpy(), np.stack(expected, -1), rtol=0, atol=1e-12)


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_a_lower_degree_is_a_prefix(degree: int):
    directions, _ = sphere_quadrature()
    assert torch.equal(sh_basis(directions, degree), sh_basis(directions, 3)[:, : basis_count(degree)])


def test_the_constants_of_the_file_format():
    """Signs and figures that viewers of 3DGS's PLY files use."""
    x, y, z = torch.eye(3, dtype=torch.float64).unbind(0)
    basis = sh_basis(torch.stack([x, y, z]), 1)
    assert basis[:, 0].tolist() == pytest.approx([0.28209479177387814] * 3)
    torch.testing.assert_close(
        basis[:, 1:],
        0.4886025119029199 * torch.tensor([[0.0, 0, -1], [-1, 0, 0], [0, 1, 0]], dtype=torch.float64),
    )


def test_colors_round_trip():
    rgb = torch.tensor([[0.0, 0.5, 1.0]], dtype=torch.float64)
    torch.testing.assert_close(rgb_from_sh(sh_from_rgb(rgb)), rgb)
    assert sh_from_rgb(rgb)[0, 1] == 0
