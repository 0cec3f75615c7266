"""The hull of a ball is nearly that ball, its normals point outwards, and masks that say nothing give none."""

import dataclasses

import numpy as np
import pytest
import torch

from ringlight.core.scene import Scene, View
from ringlight.data import hull
from ringlight.data.hull import Mask, depths_inside, masks_of, points_within, visual_hull
from tiny_scene import tiny_scene

RADIUS = 0.8


def ball_alpha(view: View) -> np.ndarray:
    """The mask of a ball around the origin, and a mid grey picture."""
    directions = view.camera.ray_directions().double()
    origin = view.camera.position.double()
    closest = origin - (directions @ origin)[..., None] * directions
    inside = (closest.norm(dim=-1) < RADIUS).numpy()
    return np.concatenate([np.full((*inside.shape, 3), 128), 255 * inside[..., None]], -1).astype(np.uint8)


@pytest.fixture(scope="module")
def ball() -> Scene:
    scene = tiny_scene(views=24, size=96)
    train = tuple(dataclasses.replace(view, load=lambda view=view: ball_alpha(view)) for view in scene.train)
    return dataclasses.replace(scene, train=train)


def test_the_hull_of_a_ball_is_the_ball(ball: Scene, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(hull, "FINE_CELLS", 64)
    found = visual_hull(masks_of(ball.train), ball.box)
    assert found is not None
    assert found.pitch == pytest.approx(2 * RADIUS / 60, rel=0.15)
    radii = found.positions.norm(dim=-1)
    # Cameras stand in two rings, so that the hull bulges above and below, where none looks along the surface.
    sides = found.positions[:, 2].abs() < 0.5 * RADIUS
    assert (radii[sides] - RADIUS).abs().mean() < 0.75 * found.pitch
    assert radii.max() < 1.35 * RADIUS
    outwards = torch.nn.functional.normalize(found.positions, dim=-1)
    assert ((found.normals * outwards).sum(-1)[sides]).mean() > 0.97
    torch.testing.assert_close(found.normals.norm(dim=-1), torch.ones(len(radii)))


def test_points_within_fill_the_ball_evenly(ball: Scene, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(hull, "FINE_CELLS", 64)
    masks, drawn = masks_of(ball.train), torch.Generator().manual_seed(0)
    points = points_within(masks, ball.box, 4000, drawn)
    assert points is not None
    assert points.shape == (4000, 3)
    # The hull bulges above and below; between its bulges it is the ball, an eighth of it within half the radius.
    sides = points[points[:, 2].abs() < 0.5 * RADIUS]
    assert sides[:, :2].norm(dim=-1).max() < 1.15 * RADIUS
    assert points.mean(0).norm() < 0.05 * RADIUS
    inner = (points.norm(dim=-1) < 0.5 * RADIUS).float().mean()
    assert 0.08 < inner < 0.14
    few = points_within(masks, ball.box, 3, drawn)
    assert few is not None
    assert few.shape == (3, 3)


def test_masks_that_leave_nothing_have_no_points_within(ball: Scene):
    nothing = [Mask(view.camera, torch.full((8, 8), -64.0)) for view in ball.train]
    assert points_within(nothing, ball.box, 5, torch.Generator()) is None
    assert points_within([], ball.box, 5, torch.Generator()) is None


def test_depths_inside_are_distances_to_the_silhouettes(ball: Scene):
    masks = masks_of(ball.train)
    radii = torch.linspace(0.5, 1.0, 26)
    # In the plane of the upper cameras' ring silhouettes are nearly tangent to the ball where it is seen edge on.
    depths = depths_inside(torch.stack([radii, 0 * radii, 0 * radii], -1), masks, band=0.15)
    torch.testing.assert_close(depths, (RADIUS - radii).clamp(-0.15, 0.15), atol=0.03, rtol=0)


def test_what_too_few_views_look_at_is_outside(ball: Scene):
    points = torch.tensor([[0.0, 0.0, 0.0], [0.0, 0.0, 50.0]])
    torch.testing.assert_close(depths_inside(points, masks_of(ball.train), 0.1), torch.tensor([0.1, -0.1]))


def test_a_mask_knows_where_in_a_pixel_its_edge_runs():
    alpha = np.zeros((20, 20), np.float32)
    for share in (0.25, 0.75):
        alpha[:, :10], alpha[:, 10] = 1, share
        inside = Mask.from_alpha(tiny_scene(views=1, size=20).train[0].camera, alpha).inside[10]
        edge = float(inside[9] / (inside[9] - inside[11]) * 2 + 9.5)  # where the distance is zero, in pixels
        assert edge == pytest.approx(10 + share, abs=0.15)
        assert float(inside[3]) == pytest.approx(10 + share - 3.5, abs=0.6)


def test_masks_without_an_edge():
    camera = tiny_scene(views=1, size=20).train[0].camera
    assert (Mask.from_alpha(camera, np.ones((20, 20), np.float32)).inside > 0).all()
    assert (Mask.from_alpha(camera, np.zeros((20, 20), np.float32)).inside < -100).all()


def test_photographs_without_alpha_or_all_opaque_have_no_masks(ball: Scene):
    opaque = np.full((96, 96, 4), 255, np.uint8)
    assert masks_of([dataclasses.replace(view, has_alpha=False) for view in ball.train]) == []
    assert masks_of([dataclasses.replace(view, load=lambda: opaque) for view in ball.train]) == []
    assert visual_hull([], ball.box) is None


def test_masks_that_contradict_each_other_leave_nothing(ball: Scene):
    masks = masks_of(ball.train)
    empty = dataclasses.replace(masks[0], inside=torch.full_like(masks[0].inside, -400.0))
    assert visual_hull([empty, *masks], ball.box) is None


def test_few_of_many_views_carve(ball: Scene, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(hull, "MOST_VIEWS", 5)
    cameras = [mask.camera for mask in masks_of(ball.train)]
    assert cameras == [ball.train[index].camera for index in (0, 5, 11, 17, 23)]
