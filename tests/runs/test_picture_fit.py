"""Harmonics fitted to a mirror's own pictures show more of it than what its Gaussians emit one by one."""

from dataclasses import replace

import pytest
import torch

from ringlight.bench.step import subject_of_workload
from ringlight.bench.workload import Size, workload_camera
from ringlight.errors import RecipeError
from ringlight.files.bake import bake_to_sh
from ringlight.methods.table import METHODS
from ringlight.rasterize.choose import rasterizer_for
from ringlight.runs.picture_fit import LONGEST_SIDE, _small, fitted_to_pictures, with_harmonics

SIDE = 48
WHITE = torch.ones(3)


@pytest.fixture(scope="module")
def mirror():
    recipe = METHODS["ringlight-mirror"]
    subject = subject_of_workload("ringlight-mirror", recipe, Size.parse(f"400@{SIDE}"), rasterizer_for("cpu"))
    model = subject.training.model
    draw = torch.Generator().manual_seed(3)
    with torch.no_grad():  # as large a residual as a trained network's; a new one's is nearly nothing
        model.get_parameter("columns.normals").copy_(torch.randn(len(model), 3, generator=draw))
        model.get_parameter(f"shader.mlp.{2 * recipe.shader.hidden_layers}.weight").mul_(30)
        for name, parameter in model.shader.named_parameters():
            if name.startswith("maps"):
                parameter.copy_(torch.randn(parameter.shape, generator=draw))
    cameras = [workload_camera(SIDE, turn) for turn in (0.0, 0.5, 1.0)]
    with torch.no_grad():
        baked = bake_to_sh(model.gaussians, cameras, model.emitted)
    return model, replace(model.gaussians, appearance={"sh_dc": baked.sh_dc, "sh_rest": baked.sh_rest}), cameras


@torch.no_grad()
def error(model, harmonics, cameras) -> float:
    baked = with_harmonics(model, harmonics)
    pairs = [(baked.render(camera, WHITE).color, model.render(camera, WHITE).color) for camera in cameras]
    return sum((ours - theirs).square().mean().item() for ours, theirs in pairs) / len(pairs)


def test_the_pictures_come_closer_and_the_shape_stays(mirror):
    model, harmonics, cameras = mirror
    fitted = fitted_to_pictures(model, harmonics, cameras, 40)
    assert error(model, fitted, cameras) < 0.9 * error(model, harmonics, cameras)
    for name in ("means", "quats", "log_scales", "opacity_logits"):
        assert torch.equal(getattr(fitted, name), getattr(harmonics, name))


def test_opacities_come_along_where_they_are_asked_for(mirror):
    model, harmonics, cameras = mirror
    fainter = replace(harmonics, opacity_logits=harmonics.opacity_logits - 1)
    alone, both = (fitted_to_pictures(model, fainter, cameras, 40, opacities) for opacities in (False, True))
    assert torch.equal(alone.opacity_logits, fainter.opacity_logits)
    assert not torch.equal(both.opacity_logits, fainter.opacity_logits)
    assert error(model, both, cameras) < error(model, alone, cameras)
    assert torch.equal(both.means, harmonics.means)


def test_the_bits_repeat_and_the_model_is_left_alone(mirror):
    model, harmonics, cameras = mirror
    before = {name: value.clone() for name, value in model.state_dict().items()}
    first, second = (fitted_to_pictures(model, harmonics, cameras, 7) for _ in range(2))
    assert torch.equal(first.appearance["sh_rest"], second.appearance["sh_rest"])
    assert not torch.equal(first.appearance["sh_rest"], harmonics.appearance["sh_rest"])
    for name, value in model.state_dict().items():
        assert torch.equal(value, before[name])


def test_large_pictures_are_drawn_smaller_and_small_ones_as_they_are():
    large = _small(workload_camera(3 * LONGEST_SIDE))
    assert (large.width, large.height) == (LONGEST_SIDE, LONGEST_SIDE)
    assert _small(workload_camera(SIDE)).width == SIDE


def test_a_negative_number_of_pictures_is_refused(tmp_path):
    from ringlight.cli.export import main

    with pytest.raises(RecipeError, match="--fit-steps is -1"):
        main([str(tmp_path), str(tmp_path / "out.ply"), "--fit-steps", "-1"])
