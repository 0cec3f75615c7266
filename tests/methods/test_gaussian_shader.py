"""gaussian-shader: Gaussians that are shaded one by one."""

from dataclasses import replace

import pytest
import torch

from contracts.methods import small
from ringlight.errors import RecipeError
from ringlight.files.page.shown import shown_of
from ringlight.fit.train import Training, train
from ringlight.methods.gaussian_shader import GaussianShaderRecipe
from ringlight.models.splats import SplatModel
from ringlight.rasterize.choose import rasterizer_for
from tiny_scene import tiny_scene

STEPS = 12
SCENE = tiny_scene(views=4, size=24)


def trained(**settings: object) -> tuple[Training, SplatModel]:
    recipe = replace(small("gaussian-shader", STEPS), environment_side=16, **settings)  # type: ignore[arg-type]
    training: Training = recipe.build(SCENE, rasterizer_for("auto"), 3)
    for progress in train(training):
        assert progress.fault is None
    splats = training.model.splats()
    assert splats is not None
    return training, splats


def test_materials_normals_and_environment_are_learned():
    training, model = trained()
    assert set(training.regularizers) == {"consistency", "zero-one", "residuals"}
    texels = model.get_parameter("color.light.texels")
    assert texels.std() > 0
    for column in ("tint_logits", "roughness_logits", "normal_residuals"):
        assert model.columns[column].std() > 0, column
    layers = model.layers(SCENE.train[0].camera)
    assert {"base", "residual", "normal", "tint", "roughness"} <= layers.keys()
    assert all(layer.isfinite().all() for layer in layers.values())


def test_a_weight_of_zero_leaves_a_term_out():
    training, _ = trained(consistency=0.0, zero_one=0.0)
    assert set(training.regularizers) == {"residuals"}
    assert training.buffers_at(1) == ()


def test_added_steps_are_asked_for_normals_too():
    training, _ = trained(consistency_every=4)
    training.extend(8)
    asked = [step for step in range(1, STEPS + 9) if "consistency" in training.regularizers_at(step)]
    assert asked == [4, 8, 12, 16, 20]


@pytest.mark.parametrize("ambient", [False, True])
def test_a_page_is_told_its_maps(ambient: bool):
    _, model = trained(ambient=ambient)
    shown = shown_of(model)
    assert shown.sizes["AMBIENT"] == ambient
    assert shown.settings["levels"] == [[16, 0.08], [8, 1.0], [8, 0.0]]
    assert model.color.axes_are_normals
    assert shown.lit


@pytest.mark.parametrize(
    ("setting", "value"),
    [
        ("first_tint", 1.0),
        ("consistency", -1.0),
        ("consistency_stride", 0),
        ("coarse_steps", -1),
        ("material_rate", -1.0),
    ],
)
def test_settings_out_of_range_are_refused(setting: str, value: float):
    with pytest.raises(RecipeError, match=setting):
        GaussianShaderRecipe(**{setting: value})  # type: ignore[arg-type]


def test_rates_of_the_light_are_the_papers_in_long_runs_and_as_stated_in_any():
    of_paper = {"environment_rate": 1.6e-2, "material_rate": 1.6e-2, "normal_rate": 1.6e-2}
    assert GaussianShaderRecipe(steps=30_000).light_rates == of_paper
    short, middle = (GaussianShaderRecipe(steps=steps).light_rates for steps in (7_000, 15_000))
    assert short == GaussianShaderRecipe(steps=100).light_rates
    assert short["normal_rate"] < middle["normal_rate"] < 1.6e-2 < middle["material_rate"] < short["material_rate"]
    stated = GaussianShaderRecipe(steps=100, material_rate=0.0).at_length()
    assert (stated.material_rate, stated.normal_rate) == (0.0, short["normal_rate"])


def test_first_surfaces_have_the_points_colours():
    recipe = GaussianShaderRecipe(environment_side=16, first_tint=0.05)
    color, _ = recipe.parts(SCENE.box)
    points = replace(SCENE.points, colors=torch.full_like(SCENE.points.colors, 0.9))
    columns = color.new_columns(points)
    assert columns["tint_logits"].sigmoid().mean().item() == pytest.approx(0.05)
    assert columns["sh_dc"].isfinite().all()
