"""The tiny scene: repeatable, seen by its cameras, and different from different sides."""

import torch

from tiny_scene import BALLS, tiny_scene


def test_the_same_seed_gives_the_same_bits():
    first, again, other = tiny_scene(), tiny_scene(), tiny_scene(seed=1)
    white = first.background_color
    pairs = list(zip(first.train, again.train, strict=True))
    assert all(torch.equal(a.image(white), b.image(white)) for a, b in pairs)
    assert torch.equal(first.points.positions, again.points.positions)
    assert not torch.equal(first.train[0].image(white), other.train[0].image(white))


def test_sizes_and_splits():
    scene = tiny_scene(views=12, size=20)
    assert (len(scene.train), len(scene.test)) == (12, 3)
    assert scene.train[0].load().shape == (20, 20, 4)
    positions = {tuple(view.camera.position.tolist()) for view in (*scene.train, *scene.test)}
    assert len(positions) == 15


def test_every_camera_sees_the_subject_and_the_background():
    for view in (*tiny_scene().train, *tiny_scene().test):
        alpha = view.load()[..., 3]
        assert 0.1 < (alpha == 255).mean() < 0.8
        assert (alpha[[0, -1]] == 0).all()
        assert (alpha[:, [0, -1]] == 0).all()


def test_points_project_into_the_balls():
    scene = tiny_scene(size=64)
    for view in scene.train:
        camera = view.camera
        local = scene.points.positions @ camera.world_to_camera[:3, :3].T + camera.world_to_camera[:3, 3]
        pixels = (local[:, :2] / local[:, 2:] * torch.tensor(camera.focal) + torch.tensor(camera.center)).long()
        alpha = torch.from_numpy(view.load())[pixels[:, 1], pixels[:, 0], 3]
        assert (alpha > 0).float().mean() > 0.9


def test_the_subject_lies_in_the_box():
    scene = tiny_scene()
    centers, radii = torch.from_numpy(BALLS[:, :3]).float(), torch.from_numpy(BALLS[:, 3:4]).float()
    assert (centers - radii >= scene.box[0]).all()
    assert (centers + radii <= scene.box[1]).all()
