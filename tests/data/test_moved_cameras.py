"""Cameras that are moved: which, how far, without a turn, and the same in any order."""

import torch

from ringlight.data.batches import ImageBatches
from ringlight.data.moved_cameras import MovedCameras, moved
from tiny_scene import tiny_scene

FIRST, LAST = 10, 130


def batches(deviation: float = 0.05) -> tuple[MovedCameras, ImageBatches]:
    photographs = ImageBatches(tiny_scene(views=6, size=16), 3)
    return MovedCameras(photographs, FIRST, LAST, deviation, 3), photographs


def test_two_of_three_are_moved_between_first_and_last():
    found, photographs = batches()
    for step in range(1, LAST + 20):
        same = found.at(step).camera is photographs.at(step).camera
        assert same is (not FIRST < step <= LAST or step % 3 == 0)
        assert found.at(step).index == photographs.at(step).index


def test_offsets_are_normal_and_the_axes_stay():
    found, photographs = batches()
    offsets = []
    for step in range(FIRST + 1, LAST + 1):
        camera, own = found.at(step).camera, photographs.at(step).camera
        assert torch.equal(camera.world_to_camera[:3, :3], own.world_to_camera[:3, :3])
        assert (camera.focal, camera.center) == (own.focal, own.center)
        if step % 3:
            offsets.append(camera.position - own.position)
    assert 0.04 < float(torch.stack(offsets).std()) < 0.06


def test_a_step_is_the_same_whatever_came_before():
    one, other = batches()[0], batches()[0]
    other.at(77)
    assert torch.equal(one.at(50).camera.world_to_camera, other.at(50).camera.world_to_camera)


def test_a_camera_moves_by_the_offset():
    camera, offset = batches()[1].at(1).camera, torch.tensor([0.3, -0.2, 0.1])
    torch.testing.assert_close(moved(camera, offset).position, camera.position + offset)
