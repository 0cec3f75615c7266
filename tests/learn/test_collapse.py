"""A light field that high rates drive to the ends of its range, on a bundled scene: with its guard it learns."""

import dataclasses

import pytest

from ringlight.data.bundled import bundled_scene
from ringlight.data.load import load_scene
from ringlight.data.options import SceneOptions
from ringlight.fit.train import train
from ringlight.methods.table import METHODS
from ringlight.models.feature_shares import feature_shares
from ringlight.rasterize.choose import rasterizer_for
from ringlight.runs.finish import psnr_of_views

FIELD_RATE = 0.1
"""Fifty times the default."""

GAIN = 4.0
"""dB; 10.4 was measured."""


@pytest.mark.slow
def test_a_collapse_is_undone_on_a_real_scene():
    scene = load_scene(bundled_scene("toaster"), SceneOptions(downscale=2))
    found = {}
    for guarded in (True, False):
        preset = METHODS["ringlight-ring"]
        recipe = dataclasses.replace(preset, steps=800, field_rate=FIELD_RATE, undo_collapse=guarded)
        training = recipe.build(scene, rasterizer_for("auto"), seed=0)
        told = [progress.collapse for progress in train(training) if progress.collapse is not None]
        assert bool(told) == guarded
        shares = feature_shares(training.model, [view.camera for view in scene.train], scene.background_color)
        assert shares is not None
        assert (shares.saturated > 0.5) is not guarded
        found[guarded] = psnr_of_views(training.model, scene)
    assert found[True] > found[False] + GAIN
