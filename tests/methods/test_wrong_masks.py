"""Masks that contradict each other: a wrong one carves nothing of the subject, and is named."""

import dataclasses
import warnings

import pytest
import torch

from ringlight.core.scene import Scene, View
from ringlight.data.hull import masks_of
from ringlight.errors import DoubtWarning
from ringlight.methods.putt import PuttRecipe
from ringlight.methods.volume_box import ChosenBox
from ringlight.methods.volume_carving import carved
from ringlight.methods.volume_training import volume_training
from ringlight.rasterize.cpu import CpuRasterizer
from ringlight.volume.model import VolumeModel
from ringlight.volume.occupancy import centers, unpacked
from tiny_scene import BALLS, tiny_scene

SCENE = tiny_scene(views=12, size=48)
NODES = 64


def without_a_ball(view: View) -> View:
    """The photograph with a mask that is wrong: the right half shows nothing."""
    pixels = view.load().copy()
    pixels[:, pixels.shape[1] // 2 :, 3] = 0
    return dataclasses.replace(view, load=lambda: pixels)


def all_of_it(view: View) -> View:
    """The photograph with a mask that shows the subject everywhere."""
    pixels = view.load().copy()
    pixels[..., 3] = 255
    return dataclasses.replace(view, load=lambda: pixels)


ONE_WRONG = dataclasses.replace(SCENE, train=(*SCENE.train[:3], without_a_ball(SCENE.train[3]), *SCENE.train[4:]))


@pytest.fixture(autouse=True)
def the_right_box(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ringlight.methods.wrong_masks.volume_box", lambda _: ChosenBox(SCENE.box, "the masks"))


def left_at_first(scene: Scene, box: torch.Tensor = SCENE.box) -> torch.Tensor:
    """Cells that a run's rays do not skip in its first step."""
    recipe = PuttRecipe(steps=10, finest=NODES, bounds=tuple(box.flatten().tolist()))
    model = volume_training(recipe, scene, CpuRasterizer(), 0).model
    assert isinstance(model, VolumeModel)
    return unpacked(model.occupied)


def carved_by_all(scene: Scene, box: torch.Tensor = SCENE.box) -> torch.Tensor:
    left = carved(masks_of(scene.train), box, NODES)
    assert left is not None
    return left


def shares_of_balls(left: torch.Tensor) -> torch.Tensor:
    x, y, z = left.shape
    places = SCENE.box[0] + centers((x, y, z)) * (SCENE.box[1] - SCENE.box[0])
    inside = torch.cdist(places, torch.tensor(BALLS[:, :3]).float()) < torch.tensor(BALLS[:, 3]).float()
    return (left.flatten()[:, None] & inside).sum(0) / inside.sum(0)


def test_one_wrong_mask_carves_nothing_of_the_subject_and_is_named():
    assert shares_of_balls(carved_by_all(ONE_WRONG)).min() < 0.5
    with pytest.warns(DoubtWarning, match=f"that of {SCENE.train[3].name} leaves out"):
        left = left_at_first(ONE_WRONG)
    assert shares_of_balls(left).min() == 1
    assert left.float().mean() < 0.3


def test_where_masks_are_right_nothing_comes_back():
    with warnings.catch_warnings():
        warnings.simplefilter("error", DoubtWarning)
        assert torch.equal(left_at_first(SCENE), carved_by_all(SCENE))


def test_a_mask_that_shows_the_subject_everywhere_brings_little_back():
    """The rays of its photograph go where all other masks have nothing."""
    with pytest.warns(DoubtWarning):
        left = left_at_first(dataclasses.replace(SCENE, train=(all_of_it(SCENE.train[0]), *SCENE.train[1:])))
    share, of_right = (float(each.float().mean()) for each in (left, carved_by_all(SCENE)))
    assert of_right < share < 1.2 * of_right  # what a single mask carves; the cone of a whole picture is a half


def test_a_box_that_cuts_the_subject_off_is_no_contradiction():
    box = SCENE.box * torch.tensor([0.75, 1.0, 1.0])
    with warnings.catch_warnings():
        warnings.simplefilter("error", DoubtWarning)
        assert torch.equal(left_at_first(SCENE, box), carved_by_all(SCENE, box))
