"""Parts of a window are the parts of one picture."""

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from ringlight.view.panes import behind_curtain, joined, side_by_side
from tiny_scene import tiny_scene

CAMERA = tiny_scene(views=4, size=24).train[0].camera.resized(60, 40)
RAYS = CAMERA.ray_directions()


@given(st.floats(-1, 2))
def test_both_sides_of_a_curtain_show_one_view(place: float):
    panes = behind_curtain(CAMERA, "a", "b", place)
    rays = torch.cat([pane.camera.ray_directions() for pane in panes], 1)
    assert torch.allclose(rays, RAYS, atol=1e-6)
    assert [pane.source for pane in panes] == sorted({pane.source for pane in panes})
    assert abs(sum(p.camera.width for p in panes if p.source == "a") - 60 * min(max(place, 0), 1)) <= 0.5


@pytest.mark.parametrize("count", [1, 2, 3, 7])
def test_strips_fill_the_window_and_look_at_its_middle(count: int):
    panes = side_by_side(CAMERA, [str(index) for index in range(count)])
    assert sum(pane.camera.width for pane in panes) == 60
    for pane in panes:
        width = pane.camera.width
        middle = pane.camera.ray_directions().mean((0, 1))
        assert torch.allclose(middle / middle.norm(), CAMERA.forward, atol=1e-5)
        begin = (60 - width) // 2
        if (60 - width) % 2 == 0:
            assert torch.allclose(pane.camera.ray_directions(), RAYS[:, begin : begin + width], atol=1e-6)


def test_a_window_of_one_pixel_shows_one_source():
    assert len(side_by_side(CAMERA.resized(1, 1), ["a", "b"])) == 1


def test_a_line_stands_where_a_part_ends():
    whole = joined([torch.ones(2, 3, 3), torch.ones(2, 2, 3)])
    assert whole.shape == (2, 5, 3)
    assert whole[..., 0].tolist() == [[1, 1, 0, 1, 1]] * 2
    assert joined([torch.ones(2, 3, 3)]).min() == 1
