"""The only list of methods: name on the command line -> preset. Torch-free."""

from difflib import get_close_matches
from typing import Any

from ringlight.core.json_numbers import without_infinity
from ringlight.errors import RecipeError
from ringlight.methods import ringlight_ring, three_dgs
from ringlight.methods.gaussian_shader import GaussianShaderRecipe
from ringlight.methods.glossy_gaussian import GlossyGaussianRecipe
from ringlight.methods.light_gaussian import LightGaussianRecipe
from ringlight.methods.putt import PuttRecipe
from ringlight.methods.recipe import Recipe, recipe_from_dict
from ringlight.methods.ringlight import RingLightRecipe
from ringlight.methods.ringlight_basis import RingLightBasisRecipe
from ringlight.methods.ringlight_mirror import RingLightMirrorRecipe
from ringlight.methods.ringlight_ring import RingLightRingRecipe
from ringlight.methods.tensorf import TensorfRecipe
from ringlight.methods.three_dgs import ThreeDGSRecipe
from ringlight.methods.three_dgs_dr import ThreeDGSDRRecipe
from ringlight.methods.three_igs import ThreeIGSRecipe

METHODS: dict[str, Recipe] = {
    "ringlight": RingLightRecipe(),
    "ringlight-basis": RingLightBasisRecipe(),
    "ringlight-ring": RingLightRingRecipe(),
    "ringlight-mirror": RingLightMirrorRecipe(),
    "ringlight-paper": ringlight_ring.PAPER,
    "3dgs": ThreeDGSRecipe(),
    "3dgs-paper": three_dgs.PAPER,
    "light-gaussian": LightGaussianRecipe(),
    "3dgs-dr": ThreeDGSDRRecipe(),
    "gaussian-shader": GaussianShaderRecipe(),
    "glossy-gaussian": GlossyGaussianRecipe(),
    "tensorf": TensorfRecipe(),
    "putt": PuttRecipe(),
    "3igs": ThreeIGSRecipe(),
}

CHOOSERS = ("ringlight",)
"""Those that settle on another method by the scene: no run and no file is of theirs."""


def method_of(recipe: Recipe) -> str:
    """What model files and reports call the method of a recipe: the first preset of its kind, whatever its settings."""
    return next(name for name, preset in METHODS.items() if type(preset) is type(recipe))


def recipe_of_method(name: str, values: Any, where: str) -> Recipe:
    """The recipe with these settings of the method that :func:`method_of` calls so, from a file: ``where``.

    Raises KeyError for any other name, RecipeError as :func:`recipe_from_dict`.
    """
    kinds = {method_of(recipe): type(recipe) for preset, recipe in METHODS.items() if preset not in CHOOSERS}
    return recipe_from_dict(kinds[name], without_infinity(values), where)


def method_named(name: str) -> Recipe:
    """The preset called ``name``; raises RecipeError with the nearest names."""
    if name in METHODS:
        return METHODS[name]
    near = get_close_matches(name, METHODS, n=1)
    hint = f"perhaps you meant {near[0]!r}" if near else f"known methods: {', '.join(METHODS)}"
    raise RecipeError(f"no method is called {name!r}; {hint}")
