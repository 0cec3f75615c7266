"""A photograph lies where the model shows the same things."""

from dataclasses import replace

import pytest
import torch

from ringlight.core.camera import Camera
from ringlight.view.photograph import NOTHING, placed
from tiny_scene import tiny_scene

TAKEN = replace(tiny_scene(views=4, size=40).train[0].camera, width=48, center=(21.0, 23.0))


def colored_by_ray(camera: Camera) -> torch.Tensor:
    """A photograph whose colours are smooth functions of the direction: what any other camera there must show too."""
    x, y, z = camera.ray_directions().unbind(-1)
    return torch.stack([0.5 + 0.3 * x, 0.5 + 0.3 * y, 0.5 + 0.3 * z])


@pytest.mark.parametrize(("width", "height", "zoom"), [(48, 40, 1.0), (200, 100, 2.0), (20, 30, 0.5), (31, 17, 0.3)])
def test_each_pixel_shows_its_direction(width: int, height: int, zoom: float):
    focal = (TAKEN.focal[0] * zoom, TAKEN.focal[1] * zoom)
    seen = replace(TAKEN, width=width, height=height, center=(width / 2, height / 2), focal=focal)
    found, wanted = placed(colored_by_ray(TAKEN), TAKEN, seen), colored_by_ray(seen).permute(1, 2, 0)
    inside = (found != NOTHING).any(-1)
    assert inside.float().mean() > 0.2
    assert torch.allclose(found[inside], wanted[inside], atol=0.01)


def test_the_same_camera_shows_the_photograph_itself():
    photograph = torch.rand(3, 40, 48)
    assert torch.allclose(placed(photograph, TAKEN, TAKEN), photograph.permute(1, 2, 0), atol=1e-4)


def test_beyond_its_edges_there_is_nothing():
    found = placed(torch.ones(3, 40, 48), TAKEN, replace(TAKEN, width=148, center=(71.0, 23.0)))
    assert (found[:, 50:98] == 1).all()
    assert (found[:, :50] == NOTHING).all()
    assert (found[:, 98:] == NOTHING).all()
