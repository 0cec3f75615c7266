"""What a report says of a trained model: also how it shows what it was trained on, and what lies far from that."""

from dataclasses import replace
from statistics import fmean

import pytest
import torch

from ringlight.core.scene import Scene, View
from ringlight.errors import SceneError
from ringlight.measure.metrics import psnr
from ringlight.models.contract import Model
from ringlight.models.feature_shares import feature_shares
from ringlight.rasterize.choose import rasterizer_for
from ringlight.runs.finish import measure, psnr_of_views
from ringlight.runs.training_facts import TrainingFacts
from small_recipes import small
from tiny_scene import tiny_scene
from voxel_grid import VoxelGrid

WHOLE = tiny_scene(views=12, size=16)
SCENE = replace(WHOLE, train=WHOLE.train[:7], test=WHOLE.train[7:11])
FACTS = TrainingFacts("voxels", "voxels")


@pytest.fixture
def model() -> Model:
    grid = VoxelGrid(4)
    torch.nn.init.uniform_(grid.colors, generator=torch.Generator().manual_seed(0))
    return grid


def psnr_on(model: Model, scene: Scene, view: View) -> float:
    background = scene.background_color
    return psnr(model.render(view.camera, background).color.detach(), view.image(background).permute(1, 2, 0))


def test_training_psnr_is_of_as_many_views_evenly_spread(model: Model):
    report = measure(model, SCENE, FACTS, nets=())
    chosen = [SCENE.train[index] for index in (0, 1, 3, 5)]
    assert report.psnr_train == pytest.approx(fmean(psnr_on(model, SCENE, view) for view in chosen), abs=1e-4)
    assert report.psnr_train != report.psnr


def test_thirds_hold_all_test_views(model: Model):
    report = measure(model, SCENE, FACTS, nets=())
    places = torch.stack([view.camera.position for view in SCENE.train])
    nearest = sorted(SCENE.test, key=lambda view: (places - view.camera.position).norm(dim=1).min().item())
    near, middle, *far = (psnr_on(model, SCENE, view) for view in nearest)  # of four views: one, one, two
    assert report.psnr_thirds == pytest.approx((near, middle, fmean(far)), abs=1e-4)


def test_views_that_the_model_was_not_trained_with_are_no_training_views(model: Model):
    others = [view.camera for view in WHOLE.train[11:]]
    report = measure(model, SCENE, FACTS, nets=(), trained=others)
    assert report.psnr_train is None
    assert report.psnr_thirds != measure(model, SCENE, FACTS, nets=()).psnr_thirds
    some = measure(model, SCENE, FACTS, nets=(), trained=[SCENE.train[2].camera])
    assert some.psnr_train == pytest.approx(psnr_on(model, SCENE, SCENE.train[2]), abs=1e-4)


def test_progress_counts_training_views_too(model: Model):
    told: list[tuple[int, int]] = []
    measure(model, SCENE, FACTS, nets=(), tell=lambda *counts: told.append(counts))
    assert told == [(done, 8) for done in range(1, 9)]


def test_two_test_views_have_no_thirds(model: Model):
    assert measure(model, replace(SCENE, test=SCENE.test[:2]), FACTS, nets=()).psnr_thirds is None


def test_test_views_are_measured_where_a_training_photograph_is_gone(model: Model):
    def gone():
        raise SceneError("r_0.png: cannot be read")

    whole = measure(model, SCENE, FACTS, nets=())
    lacking = replace(SCENE, train=(replace(SCENE.train[0], load=gone), *SCENE.train[1:]))
    report = measure(model, lacking, FACTS, nets=())
    assert report.psnr_train is None
    assert (report.psnr, report.psnr_thirds) == (whole.psnr, whole.psnr_thirds)


def test_psnr_on_the_way_is_that_of_the_report(model: Model):
    assert psnr_of_views(model, SCENE) == pytest.approx(measure(model, SCENE, FACTS, nets=()).psnr, abs=1e-4)


def test_core_seconds_are_those_of_the_training_and_of_the_choice(model: Model):
    facts = replace(FACTS, train_cpu_seconds=30.0, choosing_cpu_seconds=12.5)
    assert measure(model, SCENE, facts, nets=()).core_seconds == 42.5
    assert measure(model, SCENE, replace(facts, choosing_cpu_seconds=None), nets=()).core_seconds == 30.0
    assert measure(model, SCENE, FACTS, nets=()).core_seconds is None


def test_idle_features_are_reported_of_a_neural_light_and_of_nothing_else(model: Model):
    report = measure(model, SCENE, FACTS, nets=())
    assert (report.saturated_features, report.constant_features, report.hidden_units_off) == (None, None, None)
    ring = small("ringlight-ring", steps=4).build(SCENE, rasterizer_for("auto"), seed=0).model
    ring.get_buffer("color.lit").fill_(1)
    with torch.no_grad():
        ring.color.ring.core[:3] *= 1e9  # of six
    shares = feature_shares(ring, [view.camera for view in SCENE.train], SCENE.background_color)
    report = measure(ring, SCENE, FACTS, nets=())
    assert (report.saturated_features, report.constant_features) == (0.5, shares.constant)
    assert report.hidden_units_off == shares.off


def test_test_views_that_the_model_was_trained_on_are_counted(model: Model):
    assert measure(model, SCENE, FACTS, nets=()).test_views_trained_on == 0
    cameras = [view.camera for view in (*SCENE.train, *SCENE.test[:2])]
    assert measure(model, SCENE, FACTS, nets=(), trained=cameras).test_views_trained_on == 2
    turned = replace(SCENE.test[0].camera, world_to_camera=turn(SCENE.test[0].camera.world_to_camera))
    assert measure(model, SCENE, FACTS, nets=(), trained=[turned]).test_views_trained_on == 0


def turn(world_to_camera: torch.Tensor) -> torch.Tensor:
    """Of a camera on a tripod: it stands where it stood."""
    around = torch.eye(4)
    around[:2, :2] = torch.tensor([[0.8, -0.6], [0.6, 0.8]])
    return around @ world_to_camera
