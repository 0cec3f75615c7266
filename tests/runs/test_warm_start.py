"""What a run that starts from a model leaves out, since that has it behind it."""

from types import SimpleNamespace
from typing import Any

import pytest

from ringlight.methods.three_dgs_dr import ThreeDGSDRRecipe
from ringlight.runs.warm_start import going_on


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
