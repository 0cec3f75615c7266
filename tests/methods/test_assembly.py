"""When the loss of a run rises for good reasons."""

import torch

from ringlight.fit.strategies.densify import Densify
from ringlight.fit.strategies.densify_settings import DensifySettings
from ringlight.fit.strategies.drop_least import DropLeast
from ringlight.methods.assembly import Course, disturbed_steps
from ringlight.methods.ringlight_mirror import RingLightMirrorRecipe
from ringlight.methods.ringlight_ring import RingLightRingRecipe
from ringlight.methods.three_dgs import ThreeDGSRecipe
from tiny_scene import tiny_scene

STEPS = 8000


def steps_of(densify: DensifySettings, course: Course, white: bool = False) -> frozenset[int]:
    growing = Densify(densify, 1.0, STEPS, 0, white=white)
    dropping = DropLeast(densify, (), STEPS, torch.ones(3), 0)
    return disturbed_steps(course, growing, dropping, STEPS)


def test_opacity_resets_are_and_the_early_one_of_white_backgrounds():
    densify = DensifySettings(reset_every=1500)
    assert steps_of(densify, Course(groups={})) == {1500, 3000}, "none at the end of density control"
    assert steps_of(densify, Course(groups={}), white=True) == {500, 1500, 3000}
    assert steps_of(DensifySettings(reset_every=0), Course(groups={}), white=True) == set()


def test_rounds_in_which_gaussians_are_dropped_are():
    densify = DensifySettings(reset_every=0, drop_share=0.5)
    assert steps_of(densify, Course(groups={})) == densify.drop_rounds(STEPS)
    assert len(densify.drop_rounds(STEPS)) == 5


def test_larger_photographs_and_degrees_are_and_the_light_that_goes_on_is_not():
    unlocks = {"color.active_degree": {300: 1, 600: 2}, "color.lit": {800: 1}}
    course = Course(groups={}, unlocks=unlocks, coarse_steps=70, first_lit=800)
    assert steps_of(DensifySettings(reset_every=0), course) == {70, 140, 300, 600}


def test_a_recipe_says_which_light_is_watched_from_when_on():
    scene = tiny_scene(views=3, size=16)
    found = {}
    for recipe in (RingLightRingRecipe(steps=50), RingLightMirrorRecipe(steps=50), ThreeDGSRecipe(steps=50)):
        course = recipe.course(scene)
        found[type(recipe)] = (course.light, course.first_lit if course.light else 0)
    assert list(found.values()) == [(("color.",), 10), (("shader.",), 2), ((), 0)]
    for kind in (RingLightRingRecipe, RingLightMirrorRecipe):
        assert kind(steps=50, undo_collapse=False).course(scene).light == ()
