"""A light that is set by hand to saturate, or to be the same everywhere, is told from one that learns."""

import pytest
import torch

from ringlight.core.light_features import FeatureShares
from ringlight.core.scene import Scene
from ringlight.fit.train import Training, train
from ringlight.models.feature_shares import feature_shares
from ringlight.rasterize.choose import rasterizer_for
from small_recipes import TRAINED, small
from tiny_scene import tiny_scene

STEPS = 40
SMALL_LIGHT = {
    "ring": {"rank": 4, "features": 6, "head_hidden": 8, "position_nodes": 16, "view_nodes": 4},
    "knots": {"axis": 7, "view": 5},
    "vm": {"side": 6, "components": 2, "view": 5},
    "mlp": {"hidden": 8},
}
LIT = tuple(method for method in TRAINED if method.startswith("ringlight") and method != "ringlight-basis")
"""Methods with a neural light."""


@pytest.fixture(scope="module")
def scene() -> Scene:
    return tiny_scene(views=6, size=24)


def training_of(method: str, scene: Scene, **settings: object) -> Training:
    return small(method, steps=STEPS, **settings).build(scene, rasterizer_for("auto"), seed=0)


def idle(training: Training, scene: Scene) -> tuple[float, float] | None:
    """Shares of saturated and of constant features."""
    found = shares(training, scene)
    return None if found is None else (found.saturated, found.constant)


def shares(training: Training, scene: Scene) -> FeatureShares | None:
    return feature_shares(training.model, [view.camera for view in scene.train], scene.background_color)


def light_on(training: Training, on: bool = True) -> None:
    switch = "color.lit" if hasattr(training.model.color, "lit") else "shader.lit"
    training.model.get_buffer(switch).fill_(on)


@pytest.fixture(params=LIT)
def fresh(request: pytest.FixtureRequest, scene: Scene) -> Training:
    training = training_of(request.param, scene)
    light_on(training)
    return training


def test_a_fresh_light_is_neither_saturated_nor_constant(fresh: Training, scene: Scene):
    assert idle(fresh, scene) == (0.0, 0.0)


def test_a_trained_light_is_neither_and_says_the_same_each_time(fresh: Training, scene: Scene):
    light_on(fresh, False)
    for _ in train(fresh):
        pass
    assert idle(fresh, scene) == (0.0, 0.0)
    assert shares(fresh, scene) == shares(fresh, scene)


@pytest.mark.parametrize("field", ["ring", "discrete", "cp", "tt", "vm", "mlp"])
def test_every_field_of_the_ring_set_to_saturate_is_saturated(field: str, scene: Scene):
    training = training_of("ringlight-ring", scene, light={**SMALL_LIGHT, "field": field})
    light_on(training)
    with torch.no_grad():
        for name, parameter in training.model.named_parameters():
            if name.startswith(f"color.{field}."):
                parameter.mul_(300.0)
    found = shares(training, scene)
    assert found is not None
    assert found.saturated == 1.0


def test_exact_heads_are_looked_at_too(scene: Scene):
    training = training_of("ringlight-ring", scene, light={**SMALL_LIGHT, "evaluation": "exact"})
    light_on(training)
    assert idle(training, scene) == (0.0, 0.0)
    with torch.no_grad():
        training.model.color.ring.core.mul_(1e8)
    assert idle(training, scene) == (1.0, 0.0)


def test_one_matrix_for_all_directions_and_places_is_constant(scene: Scene):
    training = training_of("ringlight-ring", scene)
    light_on(training)
    with torch.no_grad():
        for head in (training.model.color.ring.axes, training.model.color.ring.view):
            head.networks.weights[-1].zero_()
            head.networks.biases[-1].fill_(0.3)
    assert idle(training, scene) == (0.0, 1.0)


def test_some_features_of_all_are_a_share_of_them(scene: Scene):
    training = training_of("ringlight-ring", scene)
    light_on(training)
    with torch.no_grad():
        training.model.color.ring.core[:2] *= 1e9
        training.model.color.ring.core[5] = 0
    found = shares(training, scene)
    assert found is not None
    assert found.saturated == pytest.approx(2 / 6)
    assert found.constant == pytest.approx(1 / 6)


def test_maps_without_a_picture_are_constant_and_never_saturated(scene: Scene):
    training = training_of("ringlight-mirror", scene)
    light_on(training)
    with torch.no_grad():
        for level in training.model.shader.maps.parameters():
            level.fill_(1e4)
    assert idle(training, scene) == (0.0, 1.0)


def test_a_network_that_is_off_is_seen(scene: Scene):
    """What high rates do to it: no hidden unit is above zero anywhere, and its light is one colour for all."""
    for method, layer in (("ringlight-mirror", "shader.mlp.2.bias"), ("ringlight-ring", "color.shading.render.2.bias")):
        training = training_of(method, scene)
        light_on(training)
        before = shares(training, scene)
        with torch.no_grad():
            training.model.get_parameter(layer).fill_(-1e3)
        found = shares(training, scene)
        assert before is not None
        assert found is not None
        assert before.off < 0.5 <= found.off, "the second of two layers of one width"
        assert (found.saturated, found.constant) == (0.0, 0.0)


def test_the_ring_of_a_mirror_is_looked_at_too(scene: Scene):
    training = training_of("ringlight-mirror", scene, shader={"ring": "full"})
    light_on(training)
    assert idle(training, scene) == (0.0, 0.0)
    with torch.no_grad():
        training.model.shader.ring.core.mul_(1e9)
    found = shares(training, scene)
    assert found is not None
    assert found.saturated == pytest.approx(8 / 24), "eight features of the ring beside sixteen of the maps"


@pytest.mark.parametrize("method", [method for method in TRAINED if method not in LIT])
def test_harmonics_have_no_such_features(method: str, scene: Scene):
    assert shares(training_of(method, scene), scene) is None


@pytest.mark.parametrize("method", LIT)
def test_a_light_that_is_not_on_yet_has_none(method: str, scene: Scene):
    assert shares(training_of(method, scene), scene) is None


@pytest.mark.parametrize("method", LIT)
def test_without_cameras_there_is_nothing_to_say(method: str, scene: Scene):
    training = training_of(method, scene)
    light_on(training)
    assert feature_shares(training.model, [], scene.background_color) is None
