"""Carving: gone is what some mask shows to be empty, and nothing that photographs merely cut away."""

import dataclasses

import numpy as np
import pytest
import torch

from ringlight.core.scene import Scene, View
from ringlight.data.hull import COARSE_CELLS, masks_of
from ringlight.data.rays import Rays
from ringlight.methods.putt import PuttRecipe
from ringlight.methods.volume_box import volume_box
from ringlight.methods.volume_carving import carved
from ringlight.volume.occupancy import centers
from tiny_scene import BALLS, tiny_scene

SCENE = tiny_scene(views=12, size=48)
NODES = 48


def cut(view: View, columns: int) -> View:
    """The photograph without all but its first columns."""
    camera = dataclasses.replace(view.camera, width=columns)
    pixels = view.load()[:, :columns]
    return dataclasses.replace(view, camera=camera, load=lambda: pixels)


def scene_of_cut_photographs() -> Scene:
    """Of two in three the right half is missing: no ball but the middle one is in most of the photographs."""
    views = tuple(cut(view, 22) if index % 3 else view for index, view in enumerate(SCENE.train))
    return dataclasses.replace(SCENE, train=views)


def left_of_balls(scene: Scene) -> torch.Tensor:
    """Shares of each ball's cells that are left."""
    left = carved(masks_of(scene.train), scene.box, NODES)
    assert left is not None
    places = scene.box[0] + centers(left.shape) * (scene.box[1] - scene.box[0])
    inside = torch.cdist(places, torch.tensor(BALLS[:, :3]).float()) < torch.tensor(BALLS[:, 3]).float()
    return (left.flatten()[:, None] & inside).sum(0) / inside.sum(0)


def test_all_of_the_subject_is_left_and_most_of_the_rest_gone():
    assert (left_of_balls(SCENE) == 1).all()
    left = carved(masks_of(SCENE.train), SCENE.box, NODES)
    assert left is not None
    assert left.float().mean() < 0.4


def ends_of_balls() -> tuple[torch.Tensor, torch.Tensor]:
    balls = torch.tensor(BALLS).float()
    return (balls[:, :3] - balls[:, 3:4]).amin(0), (balls[:, :3] + balls[:, 3:4]).amax(0)


def test_the_box_holds_the_subject_and_little_else():
    scene = tiny_scene(views=12, size=200)
    low, high = ends_of_balls()
    found = volume_box(scene).box
    room = 1.3 * float((scene.box[1] - scene.box[0]).max()) / COARSE_CELLS  # one look leaves more
    assert (found[0] <= low).all()
    assert (found[0] >= low - room).all()
    assert (found[1] >= high).all()
    assert (found[1] <= high + room).all()


@pytest.mark.parametrize("radius", [0.012, 0.03, 0.06])
def test_a_subject_of_few_pixels_is_within_its_box(radius: float, monkeypatch: pytest.MonkeyPatch):
    """A ball of one to three pixels' radius, and nothing else."""
    monkeypatch.setattr("tiny_scene.BALLS", np.array([[0.1, -0.2, 0.3, radius, 0.8, 0.2, 0.1]]))
    scene = tiny_scene(views=24, size=100)
    middle = torch.tensor([0.1, -0.2, 0.3])
    found = volume_box(scene)
    assert found.source == "the masks"
    assert (found.box[0] <= middle - radius).all()
    assert (found.box[1] >= middle + radius).all()
    assert (found.box[1] - found.box[0]).max() < 0.5


def test_what_most_photographs_cut_away_is_left():
    scene = scene_of_cut_photographs()
    assert (left_of_balls(scene) == 1).all()
    low, high = ends_of_balls()
    found = volume_box(scene).box
    assert (found[0] <= low).all()
    assert (found[1] >= high).all()


def test_a_coarse_grid_passes_no_thin_part_by():
    """Steps of a grid of 16 nodes are as long as five cells."""
    recipe = PuttRecipe(finest=64)
    model = recipe.first_model(torch.tensor([[-1.0] * 3, [1.0] * 3]), 0)
    thin = torch.zeros(64, 64, 64, dtype=torch.bool)
    thin[:, :, 17] = True
    model.skip_all_but(thin)
    drawn = torch.Generator().manual_seed(0)
    origins = torch.cat([1.8 * torch.rand(500, 2, generator=drawn) - 0.9, torch.full((500, 1), 3.0)], -1)
    down = torch.tensor([0.0, 0.0, -1.0]).expand(500, 3).contiguous()
    assert model.meets_something(Rays(origins, down, torch.rand(500, generator=drawn))).all()
