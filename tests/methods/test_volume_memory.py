"""What a volume's training takes of memory: refused before it begins, with what fits."""

import pytest

from ringlight.errors import RecipeError
from ringlight.fit import room
from ringlight.fit.train import Training
from ringlight.methods import volume_memory
from ringlight.methods.tensorf import TensorfRecipe
from ringlight.rasterize.choose import rasterizer_for
from small_recipes import small
from tiny_scene import tiny_scene

SCENE = tiny_scene(views=6, size=20)


def built(**settings) -> Training:
    return small("tensorf", **settings).build(SCENE, rasterizer_for("cpu"), 3)


def fitting(rays: int, **settings) -> int:
    """The most that are proposed instead."""
    with pytest.raises(RecipeError) as caught:
        built(rays=rays, **settings)
    return int(str(caught.value).split(" rays are the most")[0].split()[-1])


def test_a_grid_that_memory_cannot_hold_is_refused_with_the_largest_that_can(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(room, "machine_memory", lambda: 40_000_000)
    with pytest.raises(
        RecipeError, match=r"a grid of 300 cubed takes .* MB .* give --last-side (\d+) or less"
    ) as caught:
        built(last_side=300)
    fits = int(str(caught.value).split("--last-side ")[1].split()[0])
    built(last_side=fits)
    with pytest.raises(RecipeError):
        built(last_side=fits + 1)
    with pytest.raises(RecipeError, match="give fewer --density-components") as caught:
        built(first_side=fits + 1, last_side=300)
    assert "--last-side 3" not in str(caught.value)


def test_rays_whose_samples_memory_cannot_hold_are_refused_with_the_most_that_it_can(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(room, "machine_memory", lambda: 40_000_000)
    with pytest.raises(RecipeError, match=r"rays is 1000000; the samples of as many take up to .* rays are the most"):
        built(rays=1_000_000)
    training = built(rays=fitting(1_000_000))
    taken = 4 * training.model.samples_of(training.batches.at(1).rays).sum() * small("tensorf").numbers_of_sample
    assert 10_000_000 < taken <= 21_000_000
    with pytest.raises(RecipeError):
        built(rays=fitting(1_000_000) + 1)


def test_what_is_known_to_be_empty_leaves_room_for_more_rays(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(room, "machine_memory", lambda: 40_000_000)
    assert fitting(1_000_000) > 1.1 * fitting(1_000_000, carve=False)


def test_photographs_that_memory_cannot_hold_are_refused(monkeypatch: pytest.MonkeyPatch):
    size = 12 * sum(view.camera.width * view.camera.height for view in SCENE.train)  # 8 of them a number and flags
    monkeypatch.setattr(volume_memory, "machine_memory", lambda: 2 * size)
    volume_memory.refuse_too_many_pixels(SCENE)
    monkeypatch.setattr(volume_memory, "machine_memory", lambda: 2 * size - 2)
    with pytest.raises(RecipeError, match="a volume draws rays from all of them: try --downscale 2"):
        volume_memory.refuse_too_many_pixels(SCENE)


def test_more_samples_than_kernels_count_are_refused(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(room, "machine_memory", lambda: 1 << 50)
    with pytest.raises(RecipeError, match="rays is 1048576; each has up to"):
        TensorfRecipe(rays=1 << 20, first_side=16, last_side=1200, steps=60).build(SCENE, rasterizer_for("cpu"), 0)
