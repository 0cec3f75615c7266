"""Normals of Gaussians that are shaded one by one, and the colour that shading gives them."""

import pytest
import torch

from ringlight.color.shaded_gaussians import RESIDUALS, ROUGHNESS, TINTS, ShadedGaussians, surface_normals
from ringlight.color.split_sum import FIRST_LIGHT, SplitSumLight
from ringlight.core.camera import Camera
from ringlight.core.directions import normalize, shortest_axes
from ringlight.core.gaussians import Gaussians
from ringlight.core.scene import PointCloud
from ringlight.core.want import Want

COUNT = 50
POSE = torch.eye(4)
POSE[2, 3] = 4.0
CAMERA = Camera(POSE, (60.0, 60.0), (32.0, 32.0), 64, 64)


def shaded(ambient: bool = False) -> tuple[ShadedGaussians, Gaussians]:
    model, drawn = ShadedGaussians(SplitSumLight(16), ambient=ambient), torch.Generator().manual_seed(2)
    points = PointCloud(torch.randn(COUNT, 3, generator=drawn), torch.rand(COUNT, 3, generator=drawn))
    scales, quats = (torch.randn(COUNT, width, generator=drawn) for width in (3, 4))
    return model, Gaussians(points.positions, scales, quats, torch.zeros(COUNT), model.new_columns(points))


def test_without_residuals_normals_are_the_shortest_axes():
    _, table = shaded()
    found = surface_normals(table, table.appearance[RESIDUALS], CAMERA.position)
    torch.testing.assert_close(found, shortest_axes(table, CAMERA.position), atol=1e-5, rtol=0)


def test_each_side_has_its_residual():
    """What one camera sees of a Gaussian is moved by the one residual, what the opposite one sees by the other."""
    _, table = shaded()
    residuals = torch.tensor([0.5, 0.0, 0.0, 0.0, 0.5, 0.0]).repeat(COUNT, 1)
    sides = []
    for position in (100 * CAMERA.position, -100 * CAMERA.position):
        axes, moved = shortest_axes(table, position), surface_normals(table, residuals, position)
        either = [normalize(axes + torch.tensor(residual)) for residual in ([0.5, 0.0, 0.0], [0.0, 0.5, 0.0])]
        distances = torch.stack([(moved - one).norm(dim=-1) for one in either])
        assert distances.amin(0).max() < 1e-5
        sides.append(distances.argmin(0))
    assert torch.equal(sides[0], 1 - sides[1])
    assert 0 < int(sides[0].sum()) < COUNT


@pytest.mark.parametrize("ambient", [False, True])
def test_an_even_environment_adds_what_the_split_sum_says(ambient: bool):
    """White, nearly smooth mirrors reflect all of it, but for grazing angles, where microfacets hide each other."""
    model, table = shaded(ambient)
    with torch.no_grad():
        table.appearance[TINTS].fill_(20.0)
        table.appearance[ROUGHNESS].fill_(-20.0)
    base = model.harmonic.emit(table, CAMERA, ("rgb",), Want.EXACT).channels
    added = model.emit(table, CAMERA, ("rgb",), Want.EXACT).channels - base
    steep = (shortest_axes(table, CAMERA.position) * normalize(CAMERA.position - table.means)).sum(-1) > 0.3
    added, base = added[steep], base[steep]
    assert len(added) > COUNT / 3
    torch.testing.assert_close(added, torch.full_like(base, FIRST_LIGHT), atol=0.02, rtol=0)
