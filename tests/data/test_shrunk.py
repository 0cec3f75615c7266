"""The first steps look at smaller photographs: the same view, on fewer pixels."""

import numpy as np
import pytest
import torch

from ringlight.core.scene import View
from ringlight.data.batches import COARSE, SMALLEST_COARSE, ImageBatches
from ringlight.data.shrunk import shrunk
from tiny_scene import tiny_scene


@pytest.mark.parametrize("factor", [2, 4])
def test_a_shrunk_view_shows_the_same_on_fewer_pixels(factor: int):
    view = tiny_scene(views=1, size=64).train[0]
    small = shrunk(view, factor)
    side = 64 // factor
    assert (small.camera.width, small.camera.height) == (side, side)
    background = torch.ones(3)
    means = view.image(background).unflatten(2, (side, factor)).unflatten(1, (side, factor)).mean((2, 4))
    # Lanczos is sharper than a mean over squares; both have the same brightness.
    assert (small.image(background) - means).abs().mean() < 0.03
    assert abs(float(small.image(background).mean() - means.mean())) < 1e-2


def test_transparent_pixels_hide_their_colour():
    scene = tiny_scene(views=1, size=64)
    pixels = np.zeros((64, 64, 4), np.uint8)
    pixels[:, :32] = (255, 0, 0, 255)
    pixels[:, 32:] = (0, 255, 0, 0)
    view = View("half", scene.train[0].camera, lambda: pixels, has_alpha=True)
    image = shrunk(view, 4).image(torch.zeros(3))
    assert image[1].max() == 0
    assert image[0, :, :6].min() > 0.95


def test_a_quarter_then_half_then_whole():
    batches = ImageBatches(tiny_scene(views=3, size=256), seed=0, coarse_steps=5)
    sides = [batches.at(step).camera.width for step in range(1, 15)]
    assert sides == [256 // COARSE[0]] * 5 + [256 // COARSE[1]] * 5 + [256] * 4
    again = ImageBatches(tiny_scene(views=3, size=256), seed=0)
    assert [again.at(s).index for s in (1, 7, 14)] == [batches.at(s).index for s in (1, 7, 14)]


def test_small_photographs_are_left_whole():
    scene = tiny_scene(views=2, size=SMALLEST_COARSE * COARSE[0] - 1)
    sides = {ImageBatches(scene, seed=0, coarse_steps=1).at(step).camera.width for step in (1, 3)}
    assert sides == {scene.train[0].camera.width}
