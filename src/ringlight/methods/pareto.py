"""Quality over megabytes and over core seconds: a method beside harmonics of every degree. Torch-free.

One point of a run's length and of a model's size suits one method, another point another one. So every method is
trained at five lengths without a bound on its size, and at five sizes in a run of full length.
"""

from dataclasses import replace

from ringlight.core.words import counted
from ringlight.methods.ringlight_basis import RingLightBasisRecipe
from ringlight.methods.splat_recipe import SplatRecipe
from ringlight.methods.three_dgs import ThreeDGSRecipe
from ringlight.methods.variant import Curve, SizeBound, Variant

PARTS = (16, 8, 4, 2, 1)
"""Lengths are these parts of the longest run; sizes these parts of the bytes that 3dgs, as it is, ends with."""

EAGER = 0.25
"""Times the threshold, where a size is to be filled: it is then the bound that ends the growth."""


def pareto(method: str, recipe: SplatRecipe) -> tuple[Variant, ...]:
    """3dgs as it is, harmonics of degree 0 to 3 that grow and drop as ringlight-basis does, and ``recipe``."""
    plain = ThreeDGSRecipe(steps=recipe.steps)
    ours = RingLightBasisRecipe()
    dense = replace(plain, densify=ours.densify, rates=ours.rates, start=ours.start)
    by_degree = {f"3dgs-degree-{degree}": replace(dense, sh_degree=degree) for degree in range(plain.sh_degree + 1)}
    whole = _name("3dgs", "steps", recipe.steps)
    bounded = [
        variant
        for name, other in {method: recipe, **by_degree}.items()
        for variant in (*_lengths(name, method, other), *_sizes(name, method, other, whole))
    ]
    *shorter, longest = _lengths("3dgs", "3dgs", plain)
    as_it_is = replace(longest, curves=(*longest.curves, Curve("3dgs", "size")))
    return (*shorter, as_it_is, *bounded)


def _name(series: str, along: str, number: int) -> str:
    return f"{series}-{along}-{number}"


def _preset(series: str, method: str) -> str:
    return method if series == method else "3dgs"


def _lengths(series: str, method: str, recipe: SplatRecipe) -> tuple[Variant, ...]:
    lengths = sorted({max(recipe.steps // part, 1) for part in PARTS})
    curve = (Curve(series, "length"),)
    return tuple(
        Variant(
            _name(series, "steps", steps), _preset(series, method), replace(recipe, steps=steps),
            counted(steps, "step"), curves=curve,
        )
        for steps in lengths
    )  # fmt: skip


def _sizes(series: str, method: str, recipe: SplatRecipe, whole: str) -> tuple[Variant, ...]:
    threshold = EAGER * recipe.densify.growth(recipe.steps).threshold
    eager = replace(recipe, densify=replace(recipe.densify, threshold=threshold))
    curve = (Curve(series, "size"),)
    return tuple(
        Variant(
            _name(series, "size", part), _preset(series, method), eager, f"1/{part} of the bytes",
            within=SizeBound(whole, 1 / part), curves=curve,
        )
        for part in PARTS
    )  # fmt: skip
