"""The camera's frame: OpenCV axes, pixel centres at .5, depth is z."""

import copy
import math
import pickle

import pytest
import torch

from ringlight.core.camera import Camera, picture_sizes
from ringlight.core.kernel_limits import MAX_IMAGE_SIDE
from ringlight.errors import BackendError


def looking_at_origin(distance: float = 4.0) -> Camera:
    matrix = torch.eye(4)
    matrix[2, 3] = distance
    return Camera(matrix, (100.0, 120.0), (32.0, 24.0), 64, 48)


def test_position_and_depth():
    camera = looking_at_origin()
    assert torch.allclose(camera.position, torch.tensor([0.0, 0.0, -4.0]))
    assert camera.depths(torch.tensor([[0.0, 0.0, 1.0], [0.0, 0.0, -5.0]])).tolist() == [5.0, -1.0]


def test_rays_go_through_pixel_centres():
    rays = looking_at_origin().ray_directions()
    assert rays.shape == (48, 64, 3)
    expected = torch.tensor([(10.5 - 32) / 100, (7.5 - 24) / 120, 1.0])
    assert torch.allclose(rays[7, 10], expected / expected.norm(), atol=1e-6)
    assert torch.allclose(rays.norm(dim=-1), torch.ones(48, 64), atol=1e-6)


def test_resizing_keeps_the_field_of_view():
    camera = looking_at_origin()
    half = camera.resized(32, 24)
    fov = [2 * math.atan(c.width / 2 / c.focal[0]) for c in (camera, half)]
    assert math.isclose(*fov)
    assert half.center == (16.0, 12.0)


def test_more_pixels_than_kernels_draw_are_refused_by_the_flags_that_help():
    with pytest.raises(BackendError, match=r"not 8193 x 20; ask for smaller ones \(--downscale .*, --width"):
        _ = looking_at_origin().resized(MAX_IMAGE_SIDE + 1, 20).native


def test_sizes_in_words():
    wide, narrow = looking_at_origin(), looking_at_origin().resized(24, 20)
    assert picture_sizes([wide, wide], "..") == "64x48"
    assert picture_sizes([wide, narrow, wide], "..") == "24x20..64x48"


def test_points_lie_in_the_pixels_whose_rays_meet_them():
    camera = looking_at_origin()
    behind, beside = camera.position - camera.forward, torch.tensor([4.0, 0.0, 0.0])
    points = torch.stack([camera.position + 3 * camera.ray_directions()[7, 10], behind, beside])
    column, row, inside = camera.pixels(points)
    assert (int(column[0]), int(row[0])) == (10, 7)
    assert inside.tolist() == [True, False, False]


def test_a_camera_that_was_drawn_goes_to_another_process():
    camera = looking_at_origin()
    assert camera.native is camera.native
    for same in (copy.deepcopy(camera), pickle.loads(pickle.dumps(camera))):
        assert torch.equal(same.world_to_camera, camera.world_to_camera)
        assert (same.focal, same.center, same.width, same.height) == ((100.0, 120.0), (32.0, 24.0), 64, 48)
