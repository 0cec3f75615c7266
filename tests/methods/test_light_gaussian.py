"""light-gaussian: its phases, what its models and files hold in each, and a start from 3dgs."""

from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Literal

import pytest
import torch

from contracts.methods import small
from ringlight.core.want import Want
from ringlight.data.batches import ImageBatch
from ringlight.data.options import SceneOptions
from ringlight.errors import RecipeError
from ringlight.files.model_file import read_model_file
from ringlight.fit.rates import GaussianRates
from ringlight.fit.strategies.drop_insignificant import DropInsignificant
from ringlight.fit.strategies.global_significance import global_significance
from ringlight.fit.strategies.removal_effects import removal_effects
from ringlight.fit.teacher import Teacher
from ringlight.fit.train import Training, train
from ringlight.methods.light_gaussian import LightGaussianRecipe
from ringlight.methods.lightening import as_files_hold
from ringlight.methods.recipe import recipe_from_dict
from ringlight.methods.store import load_model, model_header, save_model, scene_facts
from ringlight.rasterize.choose import rasterizer_for
from ringlight.runs.checkpoints import refuse_misfits
from ringlight.runs.limits import prepare_run
from ringlight.runs.warm_start import Start
from tiny_scene import tiny_scene

STEPS = 24
GROWN, RECOVERED = 12, 21
SCENE = tiny_scene(views=6, size=24)


def recipe(**settings: object) -> LightGaussianRecipe:
    """With a distillation of three of its few steps."""
    made = small("light-gaussian", STEPS)
    assert isinstance(made, LightGaussianRecipe)
    return replace(made, **{"distill_share": 0.25, **settings})  # type: ignore[arg-type]


def training_of(**settings: object) -> Training:
    return recipe(**settings).build(SCENE, rasterizer_for("auto"), 3)


def until(training: Training, step: int) -> Training:
    steps = train(training)
    while training.step < step:
        next(steps)
    return training


def test_phases_scale_with_the_run():
    found = replace(recipe(), steps=8_000)
    assert (found.grown, found.recovered) == (4_000, 7_000)
    assert found.prune_steps() == (4_000, 4_300, 4_600, 4_900, 5_200)
    later = replace(found, grow_share=0.0)
    assert (later.grown, later.recovered, later.prune_steps()[0]) == (0, 6_000, 1)


@pytest.mark.parametrize(("grow_share", "share", "recovered"), [(0.5, 0.12, 4_700), (0.0, 0.7, 1_500)])
def test_what_has_just_been_grown_recovers_the_longer(grow_share: float, share: float, recovered: int):
    found = LightGaussianRecipe(steps=5_000, grow_share=grow_share)
    assert found.recovered == recovered
    assert found.at_length().distill_share == share
    assert found.may_settle_on(found.at_length())


@pytest.mark.parametrize(
    ("settings", "idle"),
    [
        ({}, set()),
        ({"prune_share": 0.0}, {"prune_by", "prune_rounds"}),
        ({"distill_share": 0.0}, {"view_jitter", "photographs_teach"}),
        ({"codebook_size": 0}, {"codebook_share", "volume_power"}),
        ({"codebook_share": 0.0}, {"codebook_size", "volume_power"}),
        ({"codebook_share": 0.0, "prune_by": "significance"}, {"codebook_size"}),
        (
            {"codebook_share": 0.0, "prune_by": "significance", "prune_share": 0.0},
            {"prune_by", "prune_rounds", "codebook_size", "volume_power"},
        ),
    ],
)
def test_settings_that_decide_nothing_are_named(settings: dict[str, object], idle: set[str]):
    own = {field.name for field in fields(LightGaussianRecipe)} - {"densify", "average"}
    assert recipe(**settings).without_effect().keys() & own == idle


def test_the_papers_phases_are_settings():
    found = replace(recipe(), steps=40_000, grow_share=0.75, distill_share=0.5, prune_rounds=1)
    assert (found.grown, found.recovered, found.prune_steps()) == (30_000, 35_000, (30_000,))


def test_what_is_frozen_stays_so_while_harmonics_are_distilled():
    frozen = LightGaussianRecipe(steps=5_000, rates=GaussianRates(means=0.0, scales=0.0)).groups(SCENE)
    assert [frozen[f"columns.{name}"].rate.at(1.0) for name in ("means", "log_scales")] == [0.0, 0.0]


@pytest.mark.parametrize(("grow_share", "last"), [(0.1, 800), (0.5, 3_760)])
def test_nothing_grows_once_gaussians_are_dropped(grow_share: float, last: int):
    found = LightGaussianRecipe(steps=8_000, grow_share=grow_share).at_length()
    growing = found._growing()
    assert growing.densify.last_step(growing.steps) == last <= min(found.prune_steps())


@pytest.mark.parametrize("steps", [1, 2, 3, 9])
def test_runs_of_any_length_end_quantised(steps: int):
    training = until(training_of(steps=steps), steps)
    assert int(training.model.get_buffer("color.active_degree")) <= 2
    assert training.model.rendering_tensors()["columns.sh_rest"].shape[1:] == (8, 3)
    columns = {name: column.detach() for name, column in training.model.named_parameters()}
    held = as_files_hold(columns, recipe().packings)
    assert all(torch.equal(held[name], column) for name, column in columns.items())


def test_a_share_of_the_gaussians_goes_and_so_does_the_teacher():
    densify = replace(recipe().densify, stop=0.4)
    training = until(training_of(densify=densify), GROWN - 1)
    before = training.model.counted().number
    until(training, RECOVERED - 1)
    assert training.model.counted().number == pytest.approx(0.5 * before, abs=3)
    assert not teacher_of(training).is_there
    until(training, RECOVERED)
    assert teacher_of(training).is_there
    assert len(teacher_of(training).model) == training.model.counted().number
    assert int(training.model.get_buffer("color.active_degree")) == 2
    until(training, STEPS)
    assert not teacher_of(training).is_there


def teacher_of(training: Training) -> Teacher:
    return next(s.teacher for s in training.strategies if hasattr(s, "teacher"))


@pytest.mark.parametrize("by", ["significance", "effects"])
def test_those_go_that_matter_least(by: Literal["significance", "effects"]):
    training = until(training_of(prune_by=by), GROWN - 1)
    model, cameras = training.model.splats(), [view.camera for view in SCENE.train]
    assert model is not None
    [dropping] = [strategy for strategy in training.strategies if isinstance(strategy, DropInsignificant)]
    wanted = {
        "significance": global_significance(model, cameras, 0.1),
        "effects": removal_effects(model, cameras, SCENE.background_color, 3, GROWN),
    }
    assert torch.equal(dropping.worth(model, GROWN), wanted[by])
    assert not torch.equal(wanted["significance"].argsort(), wanted["effects"].argsort())


@pytest.mark.parametrize("halfway", [GROWN, RECOVERED, RECOVERED + 1, STEPS])
def test_a_run_that_stops_in_any_phase_goes_on_with_the_same_bits(halfway: int):
    whole = until(training_of(), halfway)
    state = {name: tensor.clone() for name, tensor in whole.state().items()}
    resumed = training_of()
    refuse_misfits(state, resumed)
    resumed.restore(state)
    ends = [until(training, STEPS).state() for training in (whole, resumed)]
    assert ends[0].keys() == ends[1].keys()
    assert all(torch.equal(ends[0][name], tensor) for name, tensor in ends[1].items())


@pytest.mark.parametrize("photographs_teach", [True, False])
def test_photographs_teach_where_they_were_taken_and_the_teacher_elsewhere(photographs_teach: bool):
    training = training_of(distill_share=0.75, photographs_teach=photographs_teach)
    seen = []
    for progress in train(training):
        if progress.step == STEPS:  # after the last the teacher is gone
            break
        batch, distils = progress.batch, progress.step > GROWN + 3
        assert isinstance(batch, ImageBatch)
        assert batch.photographed is not (distils and progress.step % 3 != 0)
        by_teacher = distils and not (batch.photographed and photographs_teach)
        taught = teacher_of(training).picture(batch.camera, batch.background) if by_teacher else None
        photograph = batch.view.image(batch.background)
        assert torch.equal(progress.truth, (photograph if taught is None else taught).permute(1, 2, 0))
        seen.append((distils, batch.photographed))
    assert {seen.count((True, True)), seen.count((True, False))} == {2, 6}


def test_a_run_of_before_photographs_taught_goes_on_as_it_began():
    """Its record lacks the setting, and leaves the share to the program."""
    recorded = asdict(LightGaussianRecipe(steps=5_000, grow_share=0.0))
    del recorded["photographs_teach"]
    found = recipe_from_dict(LightGaussianRecipe, recorded, "recipe.json")
    assert (found.photographs_teach, found.recovered, found.at_length().distill_share) == (False, 3_500, 0.3)


def test_a_teacher_that_draws_in_between_changes_no_gradient():
    training = until(training_of(), RECOVERED)
    camera, white = SCENE.train[0].camera, torch.ones(3)
    gradients = []
    for teaches in (False, True):
        shown = training.model.render(camera, white, Want.GRADIENTS)
        if teaches:
            teacher_of(training).picture(SCENE.train[1].camera, white)
        found = shown.backward(torch.ones_like(shown.color), {})
        gradients.append({name: torch.as_tensor(found[name]) for name in ("columns.means", "columns.opacity_logits")})
    assert all(torch.equal(gradients[0][name], gradients[1][name]) for name in gradients[0])


def test_opacities_stay_while_harmonics_are_distilled():
    training = until(training_of(codebook_share=0.0), RECOVERED)
    before = training.model.get_parameter("columns.opacity_logits").clone()
    until(training, STEPS - 1)
    assert torch.equal(training.model.get_parameter("columns.opacity_logits"), before)


@pytest.mark.parametrize("step", [GROWN, STEPS])
def test_a_file_of_any_phase_shows_what_the_model_shows(step: int, tmp_path: Path):
    """Before the end it is of degree 3 and not packed; then of degree 2, packed, with the same bits."""
    training, path = until(training_of(), step), tmp_path / "model.safetensors"
    header = model_header("light-gaussian", recipe().at_length(), step, scene_facts(SCENE))
    save_model(path, training.model, header, [])
    stored = load_model(path, rasterizer_for("auto"))
    camera = SCENE.test[0].camera
    shown = [model.render(camera, torch.ones(3)).color for model in (training.model, stored.model)]
    assert torch.equal(*shown)
    packing = read_model_file(path).stored.packing
    if step == STEPS:
        assert packing["columns.sh_rest"] == "codebook8"
        assert packing["columns.quats"] == "quaternions32"
        assert {packing[f"columns.{name}"] for name in ("log_scales", "sh_dc")} == {"fixed10"}
        assert packing["columns.opacity_logits"] == "share8"
        assert packing["columns.means"].startswith("fixed")
    assert stored.model.rendering_tensors()["columns.sh_rest"].shape[1] == (8 if step == STEPS else 15)


def test_from_a_model_of_3dgs_nothing_is_grown(tmp_path: Path):
    trained = until(small("3dgs", STEPS).build(SCENE, rasterizer_for("auto"), 3), STEPS)
    path = tmp_path / "model.safetensors"
    header = model_header("3dgs", small("3dgs", STEPS).at_length(), STEPS, scene_facts(SCENE, SceneOptions()))
    save_model(path, trained.model, header, [])
    start = Start(path, load_model(path, rasterizer_for("auto")))
    run = prepare_run(SCENE, recipe(prune_rounds=1), 3, "auto", start)
    assert isinstance(run.recipe, LightGaussianRecipe)
    assert (run.recipe.grow_share, run.recipe.coarse_steps) == (0.0, 0)
    for name, tensor in trained.model.state_dict().items():
        assert torch.equal(run.training.model.state_dict()[name], tensor)
    count = trained.model.counted().number
    assert until(run.training, 1).model.counted().number == round(0.5 * count)


def test_a_bound_is_on_the_gaussians_at_the_end():
    bounded = recipe().ending_with(100)
    assert bounded.most == 100
    assert bounded._growing().most == 200
    assert bounded.never_above(100).most == 50


@pytest.mark.parametrize(
    "wrong",
    [
        {"grow_share": 1.5},
        {"prune_share": 1.0},
        {"prune_rounds": 0},
        {"distilled_degree": 4},
        {"sh_degree": 1},
        {"codebook_size": -1},
        {"view_jitter": float("nan")},
    ],
)
def test_settings_that_mean_nothing_are_refused(wrong: dict[str, float]):
    with pytest.raises(RecipeError, match=r"; give "):
        LightGaussianRecipe(**wrong)  # type: ignore[arg-type]


def test_pictures_with_holes_are_not_distilled():
    with pytest.raises(RecipeError, match=r"dropout is 0\.1, and light-gaussian distils whole pictures"):
        LightGaussianRecipe(dropout=0.1)
