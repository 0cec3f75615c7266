"""ringlight decides where to light by a trial: what reflects is shaded per pixel, what is matte per Gaussian."""

import dataclasses

import numpy as np
import pytest
import torch

from data.scene_folders import write_blender
from ringlight.core.scene import Scene, View
from ringlight.data.border_masks import on_even_background
from ringlight.data.bundled import bundled_scene
from ringlight.data.load import load_scene
from ringlight.data.options import SceneOptions
from ringlight.data.points import random_points
from ringlight.data.shrunk import shrunk
from ringlight.methods import reflection_trial as module
from ringlight.methods.reflection_trial import (
    FEWEST_VIEWS,
    SIDE,
    STEPS,
    ReflectionTrial,
    chosen_shading,
    reflection_trial,
)
from ringlight.methods.ringlight_mirror import RingLightMirrorRecipe
from ringlight.methods.table import METHODS, method_of
from ringlight.rasterize.choose import rasterizer_for
from tiny_scene import tiny_scene


def opaque_scene(views: int = FEWEST_VIEWS) -> Scene:
    scene = tiny_scene(views=views)
    return dataclasses.replace(scene, train=tuple(without_mask(view) for view in scene.train))


def test_a_scene_without_masks_has_no_trial_and_is_lit_per_pixel_from_its_points():
    assert reflection_trial(opaque_scene(), rasterizer_for("auto"), 0, 5) is None
    settled, why = METHODS["ringlight"].settled(opaque_scene(), rasterizer_for("auto"), 0)
    assert method_of(settled) == "ringlight-mirror"
    assert why is not None
    assert why.startswith("method: ringlight-mirror, for surfaces that mirror what is around (no masks")


def test_points_that_lie_on_nothing_are_no_surface():
    scene = opaque_scene()
    random = dataclasses.replace(scene, points=random_points(scene.box, 50, seed=0))
    settled, why = METHODS["ringlight"].settled(random, rasterizer_for("auto"), 0)
    assert method_of(settled) == "ringlight-basis"
    assert "fewer than 100 points" in why


def test_a_folder_without_points_has_none_that_lie_on_a_surface(tmp_path):
    folder = write_blender(tmp_path)
    assert not load_scene(folder, SceneOptions()).points.measured


def test_where_masks_leave_nothing_it_is_3dgs():
    scene = tiny_scene(views=FEWEST_VIEWS)
    beside = dataclasses.replace(scene, box=scene.box + 100)
    settled, why = METHODS["ringlight"].settled(beside, rasterizer_for("auto"), 0)
    assert method_of(settled) == "3dgs"
    assert "leave nothing of the subject" in why


def test_few_photographs_without_masks_are_for_3dgs():
    settled, why = METHODS["ringlight"].settled(opaque_scene(FEWEST_VIEWS - 1), rasterizer_for("auto"), 0)
    assert method_of(settled) == "3dgs"
    assert f"fewer than {FEWEST_VIEWS}" in why


def test_photographs_of_one_colour_are_for_3dgs():
    def dark(view: View) -> View:
        return dataclasses.replace(view, load=lambda: np.zeros_like(view.load()[..., :3]), has_alpha=False)

    scene = tiny_scene(views=FEWEST_VIEWS)
    black = dataclasses.replace(scene, train=tuple(dark(view) for view in scene.train))
    settled, why = METHODS["ringlight"].settled(black, rasterizer_for("auto"), 0)
    assert method_of(settled) == "3dgs"
    assert why == "method: 3dgs, the plain one (each photograph is of one colour)"
    one_seen = dataclasses.replace(black, train=(*black.train[1:], scene.train[0]))
    assert chosen_shading(one_seen, rasterizer_for("auto"), 0, 5)[0] != "harmonics"


def test_an_even_background_is_as_good_as_masks():
    scene = tiny_scene(views=FEWEST_VIEWS)
    flat = dataclasses.replace(scene, train=tuple(over_white(view) for view in scene.train), background="photograph")
    trial = reflection_trial(flat, rasterizer_for("auto"), 0, 5)
    assert trial is not None
    assert trial.steps == 5


@pytest.mark.parametrize(("on_hull", "on_points", "best"), [(10.0, 20.0, 20.0), (20.0, 10.0, 20.0)])
def test_where_masks_are_guessed_the_scenes_own_points_are_tried_as_well(
    on_hull: float, on_points: float, best: float, monkeypatch: pytest.MonkeyPatch
):
    scene = tiny_scene(views=FEWEST_VIEWS)
    flat = dataclasses.replace(scene, train=tuple(over_white(view) for view in scene.train), background="photograph")
    reached = iter([on_hull, on_points, 15.0])
    monkeypatch.setattr(module, "_psnr_after", lambda training, held, behind, rounds: next(reached))
    assert reflection_trial(flat, rasterizer_for("auto"), 0, 5) == ReflectionTrial(5, best, 15.0)


def test_a_background_that_only_shrinking_makes_even_has_no_trial():
    """The run carves by the photographs as they are."""
    scene = tiny_scene(views=FEWEST_VIEWS, size=2 * SIDE)
    noisy = tuple(with_noise(over_white(view)) for view in scene.train)
    assert on_even_background([shrunk(view, 2) for view in noisy], torch.ones(3))
    assert reflection_trial(dataclasses.replace(scene, train=noisy), rasterizer_for("auto"), 0, 5) is None


def test_few_photographs_have_no_trial():
    chosen = chosen_shading(tiny_scene(views=FEWEST_VIEWS - 1), rasterizer_for("auto"), 0, 5)
    assert chosen == ("harmonics", f"fewer than {FEWEST_VIEWS} photographs")


def test_the_trial_is_no_longer_than_the_run_and_repeats_itself():
    scene = tiny_scene(views=FEWEST_VIEWS)
    first, second = (reflection_trial(scene, rasterizer_for("auto"), 3, 7) for _ in range(2))
    assert first is not None
    assert first == second
    assert first.steps == 7
    assert "7 steps" in str(first)


def test_the_trial_lights_its_mirror_as_when_its_bound_was_found(monkeypatch: pytest.MonkeyPatch):
    lit = []
    monkeypatch.setattr(RingLightMirrorRecipe, "build_on_hull", lambda recipe, *_: lit.append(recipe.first_lit))
    monkeypatch.setattr(module, "_psnr_after", lambda training, held, behind, rounds: 20.0)
    reflection_trial(tiny_scene(views=FEWEST_VIEWS), rasterizer_for("auto"), 0, 40)
    assert lit == [4]


def test_a_gain_of_a_decibel_decides():
    assert ReflectionTrial(steps=1, harmonics=20.0, reflections=21.0).reflects
    assert not ReflectionTrial(steps=1, harmonics=20.0, reflections=20.5).reflects
    assert not ReflectionTrial(steps=1, harmonics=20.0, reflections=19.0).reflects


def test_a_gain_that_is_too_small_says_what_it_must_be():
    close, clear, behind = (ReflectionTrial(STEPS, 20.0, reflections) for reflections in (20.5, 22.0, 19.0))
    assert str(close).endswith("; reflections must gain 1 dB and gained 0.50")
    assert str(ReflectionTrial(STEPS, 20.0, 20.996)).endswith("and gained 0.99")
    assert str(ReflectionTrial(20, 20.0, 20.5)).endswith(
        "gained 0.50; from --steps 1000 on it is sure, and ringlight-mirror takes no trial"
    )
    assert [", too few to be sure," in str(ReflectionTrial(steps, 20.0, 22.0)) for steps in (20, STEPS)] == [
        True,
        False,
    ]
    assert "must gain" not in str(clear) + str(behind)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["toaster", "carpaint"])
def test_the_bundled_scenes_reflect(name: str):
    trial = reflection_trial(bundled(name), rasterizer_for("auto"), 0, 1000)
    assert trial is not None
    assert trial.reflects


def bundled(name: str) -> Scene:
    return load_scene(bundled_scene(name), SceneOptions())


def without_mask(view: View) -> View:
    return dataclasses.replace(view, load=lambda: view.load()[..., :3].copy(), has_alpha=False)


def with_noise(view: View) -> View:
    """Eight steps of 255 down on every other pixel of a chessboard."""
    pixels = view.load().copy()
    odd = np.indices(pixels.shape[:2]).sum(0) % 2 == 1
    pixels[odd] = pixels[odd].clip(8) - 8
    return dataclasses.replace(view, load=lambda: pixels)


def over_white(view: View) -> View:
    pixels = view.load().astype(np.float32)
    alpha = pixels[..., 3:] / 255
    flat = np.round(pixels[..., :3] * alpha + 255 * (1 - alpha)).astype(np.uint8)
    return dataclasses.replace(view, load=lambda: flat, has_alpha=False)
