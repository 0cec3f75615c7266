"""The methods that train something, the table's and the plugs', and their sizes for tests of seconds."""

from typing import Any

from plugs.directional_opacity import DirectionalOpacityRecipe
from plugs.environment import EnvironmentRecipe
from plugs.voxels import VoxelRecipe
from ringlight.methods.recipe import Recipe
from ringlight.methods.table import CHOOSERS, METHODS
from small_recipes import SMALL, with_settings

PLUGGED: dict[str, Recipe] = {
    "directional-opacity": DirectionalOpacityRecipe(),
    "environment": EnvironmentRecipe(),
    "voxels": VoxelRecipe(),
}

TRAINED: dict[str, Recipe] = {name: r for name, r in METHODS.items() if name not in CHOOSERS} | PLUGGED

GROWING = {"threshold": 1e-5, "begin": 4, "every": 5, "stop": 0.8, "reset_every": 12, "max_gaussians": 900}
"""Density control within a few steps."""


def small(name: str, steps: int) -> Any:
    """For a scene of a few hundred Gaussians, or eight voxels a side."""
    return with_settings(TRAINED[name], SMALL | {"steps": steps, "densify": GROWING, "side": 8, "rays": 256})
