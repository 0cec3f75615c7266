"""glossy-gaussian: 3dgs whose opacities depend on the direction."""

from dataclasses import replace

import pytest
import torch

from contracts.methods import small
from ringlight.color.glossy_harmonics import OPACITY_REST
from ringlight.core.gradients import COLUMNS
from ringlight.core.want import Want
from ringlight.errors import RecipeError
from ringlight.files.page.shown import shown_of
from ringlight.fit.strategies.densify import Densify
from ringlight.fit.strategies.densify_settings import DensifySettings
from ringlight.fit.train import Training, train
from ringlight.methods.glossy_gaussian import GlossyGaussianRecipe
from ringlight.methods.table import METHODS
from ringlight.models.splats import SplatModel
from ringlight.rasterize.choose import rasterizer_for
from ringlight.runs.as_harmonics import exact_harmonics, fitted_harmonics
from tiny_scene import tiny_scene

STEPS = 20
SCENE = tiny_scene(views=6, size=24)
CAMERAS = [view.camera for view in SCENE.train]
REST = COLUMNS + OPACITY_REST


def trained(**settings: object) -> Training:
    recipe = replace(small("glossy-gaussian", STEPS), **settings)  # type: ignore[arg-type]
    training: Training = recipe.build(SCENE, rasterizer_for("auto"), 3)
    for _ in train(training):
        pass
    return training


def splats_of(training: Training) -> SplatModel:
    splats = training.model.splats()
    assert splats is not None
    return splats


def test_the_rate_goes_by_the_runs_length():
    preset = METHODS["glossy-gaussian"]
    assert isinstance(preset, GlossyGaussianRecipe)
    rates = {
        steps: replace(preset, steps=steps).at_length().opacity_rest_rate for steps in (100, 15_000, 30_000, 60_000)
    }
    assert rates == {100: 6.25e-4, 15_000: 2.5e-4, 30_000: 1.25e-4, 60_000: 1.25e-4}
    assert replace(preset, opacity_rest_rate=1e-3).at_length().opacity_rest_rate == 1e-3


def test_opacities_learn_to_depend_on_the_direction():
    model = splats_of(trained(opacity_rest_rate=2e-2))
    assert model.columns[OPACITY_REST].shape[1:] == (15,)
    assert model.columns[OPACITY_REST].any()
    seen = [model.color.emit(model.gaussians, camera, ("rgb",), Want.EXACT).opacity_factor for camera in CAMERAS[:2]]
    assert not torch.equal(*seen)  # type: ignore[arg-type]


def test_without_harmonics_of_the_opacity_the_run_is_one_of_3dgs():
    plain = replace(small("3dgs", STEPS), densify=small("glossy-gaussian", STEPS).densify)
    of_3dgs: Training = plain.build(SCENE, rasterizer_for("auto"), 3)
    for _ in train(of_3dgs):
        pass
    ours = trained(opacity_degree=0).model.rendering_tensors()
    for name, tensor in of_3dgs.model.rendering_tensors().items():
        if name.startswith(COLUMNS):
            assert torch.equal(ours[name], tensor), name


def test_density_control_carries_the_opacitys_harmonics_along():
    """A budget is met, row by row; tests/fit/test_copies.py says what copies get."""
    densify = replace(small("glossy-gaussian", STEPS).densify, kind="mcmc", max_gaussians=300)
    model = splats_of(trained(densify=densify, opacity_rest_rate=2e-2))
    assert len(model) == len(model.columns[OPACITY_REST]) == 300


def test_a_reset_lowers_opacities_towards_every_camera():
    training = small("glossy-gaussian", STEPS).build(SCENE, rasterizer_for("cpu"), 0)
    model = splats_of(training)
    drawn = torch.Generator().manual_seed(0)
    with torch.no_grad():
        model.color.active_opacity_degree.fill_(3)
        model.columns["opacity_logits"].copy_(torch.linspace(-6, 4, len(model)))
        model.columns[OPACITY_REST].normal_(0, 0.1, generator=drawn)

    def opacities() -> torch.Tensor:
        emitted = model.color.emit(model.gaussians, CAMERAS[0], ("rgb",), Want.EXACT)
        return model.gaussians.opacities * emitted.opacity_factor

    before, means = opacities(), model.gaussians.opacities
    densify = DensifySettings(reset_every=2, stop=1.0)
    Densify(densify, SCENE.extent, 10, 0, white=False)._lower(model, training.optimizer)
    share = model.gaussians.opacities / means
    assert share.min() < 0.05
    assert (share == 1).sum() > 3
    # What is added is not clamped on the way: shares are exact where neither sum was.
    inside = (before > 0.001) & (before < 0.98)
    torch.testing.assert_close(opacities()[inside], (before * share)[inside], rtol=1e-3, atol=1e-6)


def test_what_depends_on_the_camera_is_exported_as_its_mean_over_the_cameras():
    model = splats_of(trained(opacity_rest_rate=2e-2))
    assert exact_harmonics(model, CAMERAS) is None
    fitted, loss = fitted_harmonics(model, CAMERAS, 0)
    opacities = [
        model.gaussians.opacities * model.color.emit(model.gaussians, camera, ("rgb",), Want.EXACT).opacity_factor
        for camera in CAMERAS
    ]
    expected = torch.stack(opacities).mean(0)
    assert len(fitted) == len(model), "every row is seen from somewhere"
    torch.testing.assert_close(fitted.opacities, expected.clamp_max(1 - 1e-6), rtol=1e-4, atol=1e-5)
    assert loss.picture_psnr > 20
    with torch.no_grad():
        model.columns[OPACITY_REST].zero_()
    assert exact_harmonics(model, CAMERAS) is not None, "the same from every side"


def test_a_page_is_told_the_degree_of_the_opacities():
    shown = shown_of(splats_of(trained(opacity_degree=2)))
    assert shown.kind == "harmonics"
    assert shown.settings["opacityDegree"] == 2


def test_a_degree_that_is_not_there_is_refused():
    with pytest.raises(RecipeError, match="opacity_degree is 4"):
        GlossyGaussianRecipe(opacity_degree=4)
    with pytest.raises(RecipeError, match="opacity_rest_rate"):
        GlossyGaussianRecipe(opacity_rest_rate=-1.0)
