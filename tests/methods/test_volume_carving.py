"""Carving: gone is what some mask shows to be empty, and nothing that photographs merely cut away, or that one mask
shows to be empty where the others need it."""

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
from ringlight.methods.volume_training import volume_training
from ringlight.rasterize.cpu import CpuRasterizer
from ringlight.volume.model import VolumeModel
from ringlight.volume.occupancy import centers, unpacked
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


def without_a_ball(view: View) -> View:
    """The photograph with a mask that is wrong: the right half shows nothing."""
    pixels = view.load().copy()
    pixels[:, pixels.shape[1] // 2 :, 3] = 0
    return dataclasses.replace(view, load=lambda: pixels)


def with_wrong_masks(wrong: int) -> Scene:
    return dataclasses.replace(SCENE, train=(*map(without_a_ball, SCENE.train[:wrong]), *SCENE.train[wrong:]))


def carved_volume(scene: Scene) -> tuple[VolumeModel, torch.Tensor]:
    """At its coarsest, with what a run leaves of it before its first step; and shares of each ball's cells that are."""
    recipe = PuttRecipe(steps=10, finest=64, bounds=tuple(SCENE.box.flatten().tolist()))
    model = volume_training(recipe, scene, CpuRasterizer(), 0).model
    assert isinstance(model, VolumeModel)
    left = unpacked(model.occupied)
    places = SCENE.box[0] + centers(left.shape) * (SCENE.box[1] - SCENE.box[0])
    inside = torch.cdist(places, torch.tensor(BALLS[:, :3]).float()) < torch.tensor(BALLS[:, 3]).float()
    return model, (left.flatten()[:, None] & inside).sum(0) / inside.sum(0)


def test_one_wrong_mask_carves_nothing_of_the_subject():
    scene = with_wrong_masks(1)
    assert left_of_balls(scene).min() < 0.5
    model, shares = carved_volume(scene)
    assert shares.min() > 0.95
    assert unpacked(model.occupied).float().mean() < 0.5


def test_where_masks_are_right_nothing_is_given_back():
    model, _ = carved_volume(SCENE)
    left = carved(masks_of(SCENE.train), SCENE.box, 64)
    assert left is not None
    assert torch.equal(unpacked(model.occupied), left)


def test_a_mask_that_shows_the_subject_everywhere_gives_little_back():
    """The rays of its photograph go where all other masks have nothing."""
    pixels = SCENE.train[0].load().copy()
    pixels[..., 3] = 255
    wrong = dataclasses.replace(SCENE.train[0], load=lambda: pixels)
    model, _ = carved_volume(dataclasses.replace(SCENE, train=(wrong, *SCENE.train[1:])))
    right, _ = carved_volume(SCENE)
    share, of_right = (float(unpacked(each.occupied).float().mean()) for each in (model, right))
    assert of_right < share < 1.2 * of_right  # by what a single mask carved; a cone of all of the picture is half


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
