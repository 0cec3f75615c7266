"""The only list of methods: name on the command line -> preset. Torch-free."""

from difflib import get_close_matches
from typing import Any

from ringlight.errors import RecipeError
from ringlight.methods.ringlight import PAPER, RingLightRecipe
from ringlight.methods.ringlight_mirror import RingLightMirrorRecipe
from ringlight.methods.three_dgs import ThreeDGSRecipe

METHODS: dict[str, Any] = {
    "ringlight": RingLightRecipe(),
    "ringlight-mirror": RingLightMirrorRecipe(),
    "ringlight-paper": PAPER,
    "3dgs": ThreeDGSRecipe(),
}


def method_of(recipe: Any) -> str:
    """What model files and reports call the method of a recipe: the first preset of its kind, whatever its settings."""
    return next(name for name, preset in METHODS.items() if type(preset) is type(recipe))


def kind_of_method(name: str) -> type:
    """The kind of recipe that belongs to what :func:`method_of` says; raises KeyError for any other name."""
    return {method_of(recipe): type(recipe) for recipe in METHODS.values()}[name]


def method_named(name: str) -> Any:
    """The preset called ``name``; raises RecipeError with the nearest names."""
    if name in METHODS:
        return METHODS[name]
    near = get_close_matches(name, METHODS, n=1)
    hint = f"perhaps you meant {near[0]!r}" if near else f"known methods: {', '.join(METHODS)}"
    raise RecipeError(f"no method is called {name!r}; {hint}")
