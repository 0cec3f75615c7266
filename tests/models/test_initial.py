"""The table at the start: as wide as the way to the neighbours, faint, with the points' colours."""

import dataclasses

import pytest
import torch

from ringlight.color.harmonics import SphericalHarmonics
from ringlight.core.directions import normalize
from ringlight.core.scene import PointCloud
from ringlight.core.sh_basis import rgb_from_sh
from ringlight.errors import SceneError
from ringlight.models.initial import THINNESS, gaussians_from_points, quats_to


def points(*positions: tuple[float, float, float]) -> PointCloud:
    return PointCloud(
        torch.tensor(positions), torch.rand(len(positions), 3, generator=torch.Generator().manual_seed(0))
    )


def test_scales_are_the_root_mean_square_distance_of_three_neighbours():
    cloud = points((0, 0, 0.0), (1, 0, 0), (0, 2, 0), (0, 0, 2), (100, 0, 0))
    table = gaussians_from_points(cloud, SphericalHarmonics())
    torch.testing.assert_close(table.scales[0], torch.tensor([3.0**0.5] * 3))
    torch.testing.assert_close(table.opacities, torch.full((5,), 0.1))
    torch.testing.assert_close(rgb_from_sh(table.appearance["sh_dc"]), cloud.colors)
    torch.testing.assert_close(table.rotations, torch.eye(3).expand(5, 3, 3))


def test_points_in_one_place_still_have_a_size():
    table = gaussians_from_points(points(*[(1.0, 2.0, 3.0)] * 6), SphericalHarmonics())
    assert table.log_scales.isfinite().all()


def test_too_few_points_are_refused_with_the_remedy():
    with pytest.raises(SceneError, match="--initial-points"):
        gaussians_from_points(points(*[(0.0, 0.0, 0.0)] * 3), SphericalHarmonics())


def test_points_with_normals_become_discs_that_lie_in_the_surface():
    directions = torch.randn(40, 3, generator=torch.Generator().manual_seed(1))
    normals = normalize(torch.cat([directions, torch.tensor([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [1e-6, 0.0, -1.0]])]))
    cloud = PointCloud(5 * normals, torch.rand(43, 3), normals)
    table = gaussians_from_points(cloud, SphericalHarmonics(), opacity=0.7)
    torch.testing.assert_close(table.rotations[..., 2], normals, atol=1e-5, rtol=0)
    torch.testing.assert_close(table.scales[:, 2], THINNESS * table.scales[:, 0])
    torch.testing.assert_close(table.scales[:, 1], table.scales[:, 0])
    torch.testing.assert_close(table.opacities, torch.full((43,), 0.7))
    round_ones = gaussians_from_points(dataclasses.replace(cloud, normals=None), SphericalHarmonics())
    torch.testing.assert_close(table.scales[:, 0], round_ones.scales[:, 0])


def test_the_turn_to_a_normal_is_the_shortest():
    quats = quats_to(normalize(torch.tensor([[1.0, 0.0, 1.0], [0.0, 0.0, 1.0]])))
    torch.testing.assert_close(quats[1], torch.tensor([1.0, 0.0, 0.0, 0.0]))
    torch.testing.assert_close(2 * quats[0, 0].acos(), torch.tensor(torch.pi / 4))
