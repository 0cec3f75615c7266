"""What a run that starts from a model leaves out, since that has it behind it."""

from types import SimpleNamespace
from typing import Any

import pytest
import torch

from ringlight.methods.three_dgs_dr import ThreeDGSDRRecipe
from ringlight.rasterize.choose import rasterizer_for
from ringlight.runs.warm_start import colored_points, going_on
from small_recipes import small
from tiny_scene import tiny_scene


def start_from(method: str) -> Any:
    return SimpleNamespace(stored=SimpleNamespace(header=SimpleNamespace(method=method)))


@pytest.mark.parametrize(("method", "unlit"), [("3dgs", 350), ("ringlight-basis", 350), ("3dgs-dr", 150)])
def test_axes_of_other_gaussians_wait_for_the_reflection_as_points_do(method: str, unlit: int):
    """Those of the same method are normals, as those of a hull are."""
    recipe = ThreeDGSDRRecipe(steps=7_000)
    assert going_on(recipe, start_from(method)).first_lit == unlit
    asked = ThreeDGSDRRecipe(steps=7_000, warmup=0.1)
    assert going_on(asked, start_from(method)).first_lit == 700
    assert going_on(recipe, start_from(method)).coarse_steps == 0


@pytest.mark.parametrize("method", ["3dgs", "glossy-gaussian", "light-gaussian", "3dgs-dr", "gaussian-shader"])
def test_base_colours_of_harmonics_are_the_same_wherever_the_world_lies(method: str):
    scene, drawn = tiny_scene(views=4, size=16), torch.Generator().manual_seed(0)
    splats = small(method).build(scene, rasterizer_for("cpu"), seed=0).model.splats()
    assert splats is not None
    with torch.no_grad():
        splats.columns["sh_rest"].copy_(torch.randn(splats.columns["sh_rest"].shape, generator=drawn))
        here = colored_points(splats)
        splats.columns["means"].add_(5.0)
    assert torch.equal(colored_points(splats).colors, here.colors)
