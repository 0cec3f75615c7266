"""Photographs over one even colour give masks; highlights of that colour and holes are mended by the other views."""

import dataclasses

import numpy as np
import pytest
import torch
from scipy import ndimage

from ringlight.core.scene import Scene, View
from ringlight.data import border_masks as module
from ringlight.data import hull
from ringlight.data.border_masks import border_masks, cover
from ringlight.data.hull import Mask, masks_of
from ringlight.data.surface import hull_points
from tiny_scene import tiny_scene

WHITE = torch.ones(3)


def over(view: View, color: float) -> View:
    """The photograph without its mask, over an even grey in [0, 1]."""
    pixels = view.load().astype(np.float32)
    alpha = pixels[..., 3:] / 255
    flat = np.round(pixels[..., :3] * alpha + 255 * color * (1 - alpha)).astype(np.uint8)
    return dataclasses.replace(view, load=lambda: flat, has_alpha=False)


def painted(view: View, where: np.ndarray) -> View:
    """White at these pixels."""
    pixels = view.load().copy()
    pixels[where] = 255
    return dataclasses.replace(view, load=lambda: pixels)


@pytest.fixture(autouse=True)
def small_grids(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hull, "FINE_CELLS", 48)
    monkeypatch.setattr(module, "CELLS", 48)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return tiny_scene(views=20, size=64)


def disagreement(mask: Mask, view: View) -> float:
    """Pixels called wrongly, of those that surely are subject or background, as a share of the subject."""
    alpha = view.load()[..., 3]
    inside = mask.inside.numpy() > 0
    return float(((alpha == 255) & ~inside | (alpha == 0) & inside).sum() / (alpha == 255).sum())


@pytest.mark.parametrize("color", [0.0, 1.0])
def test_masks_are_those_of_the_alpha_channel(scene: Scene, color: float):
    views = [over(view, color) for view in scene.train]
    masks = border_masks(views, scene.box, torch.full((3,), color))
    assert [mask.camera for mask in masks] == [view.camera for view in scene.train]
    assert np.mean([disagreement(mask, view) for mask, view in zip(masks, scene.train, strict=True)]) < 0.01
    near = [ndimage.binary_dilation(mask.inside.abs() < 0.5) for mask in masks]
    gaps = [
        (mask.inside - true.inside).abs().numpy()[edge].mean()
        for mask, true, edge in zip(masks, masks_of(scene.train), near, strict=True)
    ]
    assert np.mean(gaps) < 0.2  # pixels: the silhouette runs where it did


def test_a_highlight_on_the_silhouette_is_mended_by_the_other_views(scene: Scene):
    first = scene.train[0]
    inside = ndimage.binary_erosion(first.load()[..., 3] == 255, iterations=4)
    column = int(inside.any(0).nonzero()[0].mean())
    torn = np.zeros_like(inside)
    torn[: int(inside[:, column].nonzero()[0].mean()), column - 1 : column + 2] = True  # from the border to the middle
    views = [painted(over(first, 1.0), torn), *(over(view, 1.0) for view in scene.train[1:])]
    mask = border_masks(views, scene.box, WHITE)[0]
    hit = torch.from_numpy(torn & inside)
    assert hit.sum() > 10
    assert (mask.inside[hit] > 0).float().mean() > 0.9


def test_a_hole_that_many_views_show_is_background(scene: Scene):
    views = [torus(view) for view in scene.train]
    masks = border_masks(views, scene.box, WHITE)
    middles = [mask.inside[32, 32] for mask in masks[::2]]  # those that look from further above
    assert all(float(view.load()[32, 32, 0]) == 255 for view in views[::2])
    assert all(float(depth) < 0 for depth in middles)


def test_a_white_spot_in_one_view_is_no_hole(scene: Scene):
    spot = np.zeros((64, 64), bool)
    spot[30:34, 30:34] = True
    views = [over(view, 1.0) for view in scene.train]
    mask = border_masks([painted(views[0], spot), *views[1:]], scene.box, WHITE)[0]
    assert (mask.inside[torch.from_numpy(spot)] > 0).all()


def torus(view: View) -> View:
    """Grey, lying around the z axis, over white."""
    along = torch.linspace(1.5, 4.5, 200)[:, None, None, None]
    points = view.camera.position + along * view.camera.ray_directions()
    off = torch.hypot(points[..., :2].norm(dim=-1) - 0.8, points[..., 2]).amin(0)
    pixels = np.where((off < 0.1)[..., None], 90, 255).repeat(3, -1).astype(np.uint8)
    return dataclasses.replace(view, load=lambda: pixels, has_alpha=False)


def test_photographs_of_a_world_have_no_even_border(scene: Scene):
    random = np.random.Generator(np.random.Philox(0))
    noise = random.integers(0, 255, (64, 64, 3), dtype=np.uint8)
    views = [dataclasses.replace(view, load=lambda: noise, has_alpha=False) for view in scene.train]
    assert border_masks(views, scene.box, WHITE) == []
    assert border_masks([over(view, 1.0) for view in scene.train], scene.box, torch.zeros(3)) == []
    assert border_masks([], scene.box, WHITE) == []


def test_cover_of_a_silhouette_pixel_is_told_from_its_colour():
    picture = np.ones((5, 8, 3), np.float32)
    subject = np.array([0.2, 0.4, 0.9], np.float32)
    picture[:, 4:] = subject
    picture[:, 3] = 0.25 * subject + 0.75
    alpha = cover(picture, np.ones(3, np.float32), (picture == 1).all(-1))
    np.testing.assert_allclose(alpha, np.broadcast_to([0, 0, 0, 0.25, 1, 1, 1, 1], (5, 8)), atol=1e-6)


def test_a_scene_over_white_without_alpha_has_a_hull(scene: Scene):
    flat = dataclasses.replace(scene, train=tuple(over(view, 1.0) for view in scene.train), background="photograph")
    found, true = hull_points(flat, 500, seed=0), hull_points(scene, 20_000, seed=0)
    assert found is not None
    assert true is not None
    assert torch.cdist(found.positions, true.positions).amin(1).median() < 0.03
