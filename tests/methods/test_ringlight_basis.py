"""ringlight-basis: small rows, rates by the length, refusals."""

import dataclasses

import pytest
import torch

from ringlight.errors import RecipeError
from ringlight.methods.ringlight_basis import RingLightBasisRecipe
from ringlight.methods.table import METHODS
from ringlight.rasterize.choose import rasterizer_for
from tiny_scene import tiny_scene


@pytest.mark.parametrize("size", [1, 8, 16])
def test_a_gaussian_is_fourteen_numbers_and_its_weights(size: int):
    model = RingLightBasisRecipe(basis_size=size).model(torch.tensor([[-1.0] * 3, [1.0] * 3]), rasterizer_for("auto"))
    rows = [t.shape[1:].numel() for name, t in model.rendering_tensors().items() if name.startswith("columns.")]
    assert sum(rows) == 14 + size


@pytest.mark.parametrize("steps", [1_000, 29_999, 30_000])
def test_base_colours_learn_as_those_of_3dgs_and_fall_in_any_run(steps: int):
    recipes = (dataclasses.replace(METHODS[name], steps=steps) for name in ("ringlight-basis", "3dgs"))
    groups = [recipe.build(tiny_scene(), rasterizer_for("auto"), 0).optimizer.groups for recipe in recipes]
    ours, theirs = (found["columns.sh_dc"].rate for found in groups)
    assert ours.at(0.75) == theirs.at(0.75) == theirs.start
    assert ours.at(1.0) == pytest.approx(ours.start / 10)
    assert (ours == theirs) is (steps < 30_000)


@pytest.mark.parametrize(
    "wrong", [{"basis_size": 0}, {"basis_size": 17}, {"weights_rate": -1.0}, {"basis_rate": float("nan")}]
)
def test_settings_out_of_range_are_refused(wrong: dict[str, float]):
    with pytest.raises(RecipeError, match=next(iter(wrong))):
        RingLightBasisRecipe(**wrong)
