"""Points to start from and the box: 3DGS's on NeRF-Synthetic, in proportion elsewhere, never empty or flat."""

import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scene_folders import look_at_origin

from ringlight.core.camera import Camera
from ringlight.core.scene import PointCloud, camera_extent
from ringlight.data.options import SceneOptions
from ringlight.data.points import default_count, random_points, scene_extent, seen_sphere, sfm_box, starting_points
from ringlight.data.poses import world_to_camera_from_opengl


def ring(scale: float = 1.0, focal: float = 1111.1, size: int = 800, shift: float = 0.0) -> list[Camera]:
    cameras = []
    for index in range(8):
        matrix = look_at_origin(index)
        position = matrix[:3, 3]
        position *= scale * 4.03 / (position @ position) ** 0.5
        position += shift
        pose = torch.from_numpy(world_to_camera_from_opengl(matrix, "")).float()
        cameras.append(Camera(pose, (focal, focal), (size / 2, size / 2), size, size))
    return cameras


def test_nerf_synthetic_starts_in_the_cube_of_3dgs():
    points, box, note = starting_points(None, ring(), SceneOptions())
    assert points.positions.shape == points.colors.shape == (100_000, 3)
    assert torch.allclose(points.positions.amax(0), torch.tensor(1.3), atol=0.02)
    assert torch.allclose(points.positions.amin(0), torch.tensor(-1.3), atol=0.02)
    assert torch.allclose(box, torch.tensor([[-1.6], [1.6]]).expand(2, 3), atol=0.02)
    assert "100000 random" in note


@settings(max_examples=25)
@given(scale=st.floats(0.01, 100), shift=st.floats(-50, 50))
def test_the_cube_follows_the_cameras(scale: float, shift: float):
    sphere = seen_sphere(ring(scale, shift=shift * scale))
    assert abs(sphere.radius / scale - 1.451) < 0.02
    assert abs(sphere.center / scale - shift).max() < 0.02


def test_the_narrow_direction_and_the_lens_count():
    assert seen_sphere(ring(focal=2222.2)).radius < 0.51 * seen_sphere(ring()).radius


def test_cameras_in_one_place_measure_by_the_box():
    box = torch.tensor([[-1.0, -1.0, -1.0], [1.0, 5.0, 1.0]])
    assert scene_extent(ring(), box) == camera_extent(ring())
    for count in (1, 3):
        assert scene_extent(ring()[:1] * count, box) == 3.0


def test_cameras_without_a_common_point_are_surrounded():
    one_place = [Camera(torch.eye(4), (10.0, 10.0), (5.0, 5.0), 10, 10)] * 3
    assert seen_sphere(one_place).radius == 1.0
    outward = []
    for camera in ring():
        matrix = camera.world_to_camera.clone()
        matrix[[0, 2]] *= -1  # turned around: what they looked at lies behind them
        outward.append(Camera(matrix, camera.focal, camera.center, 800, 800))
    sphere = seen_sphere(outward)
    assert sphere.radius > 4
    assert all((camera.position.numpy() - sphere.center).max() < sphere.radius for camera in outward)


def test_fewer_points_for_small_images():
    assert [default_count(ring(size=size)) for size in (100, 200, 201, 1600)] == [20_000, 20_000, 100_000, 100_000]


def test_the_same_seed_gives_the_same_points():
    box = torch.tensor([[-1.0, 0, 2], [1.0, 3, 4]])
    first, again, other = (random_points(box, 1000, seed) for seed in (3, 3, 4))
    assert torch.equal(first.positions, again.positions)
    assert not torch.equal(first.positions, other.positions)
    assert (first.positions >= box[0]).all()
    assert (first.positions <= box[1]).all()
    assert (first.colors - 0.5).abs().max() < 0.002


def test_a_few_outliers_do_not_stretch_the_box():
    positions = torch.rand(1000, 3, generator=torch.Generator().manual_seed(0))
    positions[:10] = 1e4
    assert sfm_box(positions).abs().max() < 1.2


def test_a_flat_cloud_has_a_box_that_is_not_flat():
    positions = torch.rand(200, 3, generator=torch.Generator().manual_seed(0))
    positions[:, 1] = 2
    box = sfm_box(positions)
    assert ((box[1] - box[0]) > 0.04).all()
    assert ((sfm_box(torch.ones(200, 3))[1] - 1) > 0).all()


def test_few_points_are_used_and_fewer_are_replaced():
    few = PointCloud(torch.rand(10, 3), torch.rand(10, 3))
    points, box, _ = starting_points(few, ring(), SceneOptions())
    assert points is few
    assert torch.allclose(box, torch.tensor([[-1.6], [1.6]]).expand(2, 3), atol=0.02)
    fewer = PointCloud(torch.rand(3, 3), torch.rand(3, 3))
    points, _, note = starting_points(fewer, ring(), SceneOptions(initial_points=12))
    assert len(points.positions) == 12
    assert "brings 3 points" in note
