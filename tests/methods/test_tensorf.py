"""tensorf: schedules that scale, a box that is chosen and told, and settings that cannot be."""

import dataclasses

import pytest
import torch

from ringlight.core.scene import Scene
from ringlight.core.want import Want
from ringlight.data.rays import rays_of
from ringlight.errors import RecipeError
from ringlight.fit.train import train
from ringlight.methods.tensorf import TensorfRecipe
from ringlight.rasterize.choose import rasterizer_for
from ringlight.volume.occupancy import unpacked
from small_recipes import small
from spoiled_volumes import assert_refused_without_its_end
from tiny_scene import tiny_scene

SCENE = tiny_scene(views=6, size=20)


def built(scene: Scene = SCENE, seed: int = 3, **settings):
    return small("tensorf", **settings).build(scene, rasterizer_for("cpu"), seed)


def without_masks() -> Scene:
    """Photographs without alpha, of a background that is nowhere even."""
    noise = torch.rand(20, 20, 3, generator=torch.Generator().manual_seed(0)).mul(255).byte().numpy()
    views = tuple(dataclasses.replace(view, load=lambda: noise, has_alpha=False) for view in SCENE.train)
    return dataclasses.replace(SCENE, train=views)


def test_its_schedules_are_shares_of_the_papers():
    recipe = TensorfRecipe(steps=3000)
    assert recipe.at_share((2000, 7000)) == (200, 700)
    rate = recipe.groups()["field.*_factors.*"].rate
    assert rate.at(0.0) == pytest.approx(0.02)
    assert rate.at(200 / 3000) < 0.02 < 1.05 * rate.at(201 / 3000)
    assert rate.at(1.0) == pytest.approx(0.02 * 0.1 ** (23 / 30))
    assert recipe.groups()["*"].rate.at(1.0) == pytest.approx(4e-3 * 0.1 ** (23 / 30))


def test_short_runs_end_with_coarser_planes():
    sides = [TensorfRecipe(steps=steps).final_side for steps in (1, 3000, 7000, 15_000, 30_000)]
    assert sides[:2] == [200, 200]
    assert 200 < sides[2] < 300
    assert sides[3:] == [300, 300]
    assert TensorfRecipe(steps=3000, last_side=300).final_side == 300
    assert TensorfRecipe(steps=3000, decomposition="cp").final_side == 500


def test_its_grid_grows_to_the_side_that_it_says_and_its_box_never_does():
    training = built(steps=60)
    before = training.model.box.clone()
    for _ in train(training):
        pass
    assert 0.6 < training.model.counted().number / 20**3 <= 1
    inside = (training.model.box[0] >= before[0]) & (training.model.box[1] <= before[1])
    assert inside.all()
    assert training.batches.kept_rays < training.batches.all_rays


def test_the_box_is_that_of_the_masks_or_of_the_scene_and_is_told():
    settled, why = TensorfRecipe().settled(SCENE, rasterizer_for("cpu"), 0)
    box = torch.tensor(settled.bounds).view(2, 3)
    assert "the masks" in why
    assert ((box[0] >= SCENE.box[0] - 1e-6) & (box[1] <= SCENE.box[1] + 1e-6)).all()
    scene = without_masks()
    settled, why = TensorfRecipe().settled(scene, rasterizer_for("cpu"), 0)
    assert torch.equal(torch.tensor(settled.bounds).view(2, 3), scene.box)
    assert "the points" in why
    few = dataclasses.replace(scene.points, positions=scene.points.positions[:99], colors=scene.points.colors[:99])
    assert "the cameras" in TensorfRecipe().settled(dataclasses.replace(scene, points=few), rasterizer_for("cpu"), 0)[1]
    cameras = dataclasses.replace(scene, points=dataclasses.replace(scene.points, origin="random"))
    assert "the cameras" in TensorfRecipe().settled(cameras, rasterizer_for("cpu"), 0)[1]


def test_a_box_that_no_ray_meets_is_refused():
    with pytest.raises(RecipeError, match="no ray of a photograph meets the box 50 50 50 51 51 51; give other"):
        built(bounds=(50.0, 50.0, 50.0, 51.0, 51.0, 51.0))


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"rays": 0}, "rays is 0; give 1"),
        ({"density_components": 0}, "density_components is 0; give 1"),
        ({"features": 10**9}, "features is 1000000000; give 1 to"),
        ({"first_side": 1}, "first_side is 1; give 2"),
        ({"last_side": 100}, "last_side is 100, below first_side, 128"),
        ({"gradient_share": 1.5}, "gradient_share is 1.5; give more than 0"),
        ({"l1": -1.0}, "l1 is -1; give 0"),
        ({"tv_density": float("nan")}, "tv_density is nan"),
        ({"decomposition": "cp", "tv_density": 0.1}, "three lines have no planes"),
        ({"rate": float("inf")}, "rate is inf"),
        ({"bounds": (0.0, 0.0, 0.0, 1.0, 0.0, 1.0)}, "bounds are 0 0 0 1 0 1; give the lowest corner"),
        ({"bounds": (0.0, 0.0, float("nan"), 1.0, 1.0, 1.0)}, "bounds are"),
        ({"bounds": (0.0, 0.0, 0.0, 1e-50, 1.0, 1.0)}, "so far that float32 tells them apart"),
        ({"bounds": (4500000.0, 0.0, 0.0, 4500000.2, 1.0, 1.0)}, "bounds are 4500000 0 0 4500000.2 1 1"),
        ({"bounds": (-3e38, 0.0, 0.0, 3e38, 1.0, 1.0)}, "bounds are"),
        ({"bounds": (0.0, 0.0, 0.0, 1e39, 1.0, 1.0)}, "bounds are"),
    ],
)
def test_settings_that_cannot_be_are_refused_in_a_sentence(settings: dict, words: str):
    with pytest.raises(RecipeError) as caught:
        TensorfRecipe(**settings)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_in_its_training_a_share_of_the_samples_hands_gradients_on():
    assert built().model.gradient_share == TensorfRecipe().gradient_share < 1
    assert built(gradient_share=1.0).model.gradient_share == 1


def test_it_begins_with_what_the_masks_leave_of_its_box():
    begun, whole = built(), built(carve=False)
    assert torch.equal(begun.model.box, whole.model.box)
    assert 0 < unpacked(begun.model.occupied).float().mean() < 0.9
    assert unpacked(whole.model.occupied).all()
    assert begun.batches.kept_rays < whole.batches.kept_rays
    for view in SCENE.train:
        rays = rays_of(view.camera)
        shows = torch.from_numpy(view.load())[..., 3].flatten() > 127
        assert begun.model.meets_something(rays)[shows].all()
    assert unpacked(built(without_masks()).model.occupied).all()


def test_three_lines_learn_too():
    training = built(decomposition="cp", steps=60, rays=64)
    losses = [progress.loss for progress in train(training)]
    assert sum(losses[-10:]) < 0.8 * sum(losses[:10])
    assert dict(training.model.named_parameters()).keys() == dict(training.optimizer.groups).keys()


def test_over_black_it_begins_to_learn_too():
    """What is all but empty is black until its colour is asked for, so that nothing would be missed over black."""
    training = built(dataclasses.replace(SCENE, background="black"), steps=200)

    def teaches(step: int) -> bool:
        batch = training.batches.at(step)
        shown = training.model.predict(batch, Want.GRADIENTS)
        compared = training.loss.compare(shown, batch, training.model)
        gradients = shown.backward(compared.grad_color, {})
        return bool(gradients["field.density_factors.planes.0"].any())

    assert teaches(13)
    assert not training.batches.at(14).background.any()


def test_variation_makes_planes_smoother():
    def roughness(weight: float) -> float:
        training = built(steps=20, l1=0.0, tv_density=weight)
        for _ in train(training):
            pass
        planes = training.model.field.density_factors.planes
        return sum((plane.diff(dim=0).abs().mean() + plane.diff(dim=1).abs().mean()).item() for plane in planes)

    assert roughness(500.0) < 0.9 * roughness(0.0)


@pytest.mark.parametrize("name", ["field.density_factors.planes.1", "field.appearance_factors.lines.0", "occupied"])
def test_a_file_whose_grids_do_not_fit_each_other_is_refused(name: str, tmp_path):
    assert_refused_without_its_end("tensorf", built(), SCENE, name, tmp_path / "model.safetensors")
