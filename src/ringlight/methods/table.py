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

ABOUT: dict[str, str] = {
    "ringlight": "chooses ringlight-basis or ringlight-mirror for the scene, or 3dgs for few photographs; start here",
    "ringlight-basis": "Gaussians, colour and opacity by a few weights of harmonics that all share: matte scenes",
    "ringlight-ring": "Gaussians lit by one shared neural tensor ring, with settings of ours",
    "ringlight-mirror": "pixels that reflect a learned light: mirrors, clear coats, photographs without masks",
    "ringlight-paper": "ringlight-ring with the settings of the RingLight-GS paper",
    "3dgs": "3D Gaussian Splatting (Kerbl et al. 2023), with rates that suit the length of the run",
    "3dgs-paper": "3dgs with its paper's rates at any length",
    "light-gaussian": "LightGaussian (Fan et al. 2024): 3dgs, then fewer Gaussians, fewer harmonics, a codebook",
    "3dgs-dr": "3DGS-DR (Ye et al. 2024): 3dgs with a cubemap that each pixel reflects",
    "gaussian-shader": "GaussianShader (Jiang et al. 2024): Gaussians that each reflect a learned environment",
    "glossy-gaussian": "Glossy-Gaussian (Zhang et al. 2025): 3dgs with opacities that depend on the direction",
    "tensorf": "TensoRF (Chen et al. 2022): a volume as planes times lines, no Gaussians",
    "putt": "PuTT (Loeschcke et al. 2024): a volume as two tensor trains, no Gaussians",
    "3igs": "3iGS (Tang and Cham 2024): 3dgs with one factorised field of light for all Gaussians",
}
"""What each is, for who chooses one by the help."""

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
