"""The table at the start: as wide as the way to the neighbours, faint, with the points' colours."""

import pytest
import torch

from ringlight.color.harmonics import SphericalHarmonics
from ringlight.core.scene import PointCloud
from ringlight.core.sh_basis import rgb_from_sh
from ringlight.errors import SceneError
from ringlight.models.initial import gaussians_from_points


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
