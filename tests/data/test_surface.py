"""Points on the surface: from the hull, or the scene's own with normals that look at the cameras."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
import torch

from ringlight.core.directions import normalize
from ringlight.core.scene import PointCloud, Scene, View
from ringlight.data import hull
from ringlight.data.photographed_colors import photographed_colors
from ringlight.data.surface import hull_points, is_cut_out, own_points, plane_normals
from tiny_scene import BALLS, tiny_scene


@pytest.fixture(autouse=True)
def small_grid(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hull, "FINE_CELLS", 64)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return tiny_scene(views=16, size=64)


def test_points_are_drawn_from_the_hull_by_the_seed(scene: Scene):
    points, again, other = (drawn(scene, 500, seed) for seed in (3, 3, 4))
    assert points.normals is not None
    assert len(points.positions) == len(points.colors) == len(points.normals) == 500
    assert torch.equal(points.positions, again.positions)
    assert not torch.equal(points.positions, other.positions)
    balls = torch.from_numpy(BALLS).float()
    gaps = (points.positions[:, None] - balls[:, :3]).norm(dim=-1) - balls[:, 3]
    assert gaps.amin(1).median().abs() < 0.1


def test_more_points_than_voxels_are_not_in_one_place(scene: Scene):
    count = 3 * len(drawn(scene, 10**4, seed=0).positions)
    points = drawn(scene, count, seed=0)
    assert len(points.positions.unique(dim=0)) > 0.99 * count


def drawn(scene: Scene, count: int, seed: int) -> PointCloud:
    points = hull_points(scene, count, seed)
    assert points is not None
    return points


def ball_points(count: int = 2000) -> torch.Tensor:
    return normalize(torch.randn(count, 3, generator=torch.Generator().manual_seed(0)))


def test_without_masks_the_scenes_own_points_get_normals(scene: Scene):
    views = tuple(dataclasses.replace(view, has_alpha=False) for view in scene.train)
    own = PointCloud(ball_points(), torch.full((2000, 3), 0.25))
    opaque = dataclasses.replace(scene, train=views, points=own)
    assert hull_points(opaque, 10, seed=0) is None
    points = own_points(opaque)
    assert points.positions is own.positions
    assert points.colors is own.colors
    assert points.normals is not None


def test_planes_through_neighbours_give_normals_towards_the_cameras(scene: Scene):
    positions = ball_points()
    outside = [view.camera for view in scene.train]
    near_equator = positions[:, 2].abs() < 0.8  # beyond, cameras on the other side see as much
    cosines = (plane_normals(positions, outside) * positions).sum(-1)[near_equator]
    assert cosines.abs().mean() > 0.99


def test_each_plane_looks_at_the_only_camera(scene: Scene):
    camera = scene.train[0].camera
    positions = ball_points()
    towards = normalize(camera.position - positions)
    normals = plane_normals(positions, [camera])
    inside = (positions * normalize(camera.position)).sum(-1) > 0.8
    assert ((normals * towards).sum(-1)[inside] > 0).all()


def test_colours_come_from_views_that_see_the_point():
    scene = tiny_scene(views=32, size=96)
    ball = torch.from_numpy(BALLS[0]).float()
    normals = ball_points(4000)
    positions = ball[:3] + ball[3] * normals
    colors = photographed_colors(positions, normals, 0.03, scene)
    lit = (colors - 0.5).abs().amax(1) > 1e-6
    assert lit.float().mean() > 0.5
    # Diffuse light dims the ball's colour, but does not turn its hue.
    hue = normalize(ball[4:])
    assert (normalize(colors[lit].mean(0)) @ hue) > 0.93


def test_a_point_that_no_camera_faces_is_grey(scene: Scene):
    normals = ball_points(50)
    far_outside = 30 * normals  # in view across the scene, but from behind
    assert torch.equal(photographed_colors(far_outside, normals, 0.01, scene), torch.full((50, 3), 0.5))
    assert not torch.equal(photographed_colors(far_outside, -normals, 0.01, scene), torch.full((50, 3), 0.5))


def test_masks_and_even_backgrounds_cut_a_subject_out(scene: Scene):
    assert is_cut_out(scene)
    assert is_cut_out(of_views(scene, over_white))
    assert not is_cut_out(of_views(scene, over_ramp))
    assert not is_cut_out(of_views(scene, over_ramp, first=15)), "one photograph has a mask, the others have none"


def test_few_photographs_tell_whether_it_is_cut_out(scene: Scene):
    looked_at: set[str] = set()

    def counted(view: View) -> View:
        return dataclasses.replace(view, load=lambda: looked_at.add(view.name) or view.load())

    assert is_cut_out(of_views(scene, counted))
    assert len(looked_at) == 8


def test_a_photograph_that_does_not_carve_needs_no_mask(scene: Scene):
    views = [dataclasses.replace(view, name=str(index)) for index, view in enumerate(scene.train * 9)]
    carving = {view.name for view in hull.evenly_chosen(views)}
    train = [view if view.name in carving else over_ramp(view) for view in views]
    assert len(carving) < len(train)
    assert is_cut_out(dataclasses.replace(scene, train=tuple(train)))


def of_views(scene: Scene, changed: Callable[[View], View], first: int = 16) -> Scene:
    return dataclasses.replace(scene, train=(*map(changed, scene.train[:first]), *scene.train[first:]))


def over_white(view: View) -> View:
    image = view.image(torch.ones(3)).permute(1, 2, 0).mul(255).round().byte().numpy()
    return dataclasses.replace(view, load=lambda: image, has_alpha=False)


def over_ramp(view: View) -> View:
    height, width, _ = view.load().shape
    ramp = np.broadcast_to(np.arange(width, dtype=np.uint8)[:, None], (height, width, 3)).copy()
    return dataclasses.replace(view, load=lambda: ramp, has_alpha=False)
