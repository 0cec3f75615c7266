"""The paper's studies as matrices of recipes: what is changed, what the paper reports for it, what is held against it.

Torch-free. A variant is a preset with settings changed, so its run is one that ``ringlight train`` could have made.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from difflib import get_close_matches
from typing import Any, TypeVar

from ringlight.errors import RecipeError
from ringlight.fields.ring_settings import PerceptronSettings
from ringlight.fit.photometric import PhotometricLoss
from ringlight.methods.pareto import pareto
from ringlight.methods.ringlight_basis import RingLightBasisRecipe
from ringlight.methods.ringlight_mirror import RingLightMirrorRecipe
from ringlight.methods.ringlight_ring import PAPER, RingLightRingRecipe
from ringlight.methods.splat_recipe import SplatRecipe
from ringlight.methods.three_dgs import ThreeDGSRecipe
from ringlight.methods.variant import Variant

FULL = "full"
"""Name of the unchanged base in every study, so that studies in one folder share its runs."""

PAPER_RANKS = {4: 27.71, 8: 28.94, 16: 29.01, 24: 29.10}
PAPER_FEATURES = {12: 28.42, 24: 28.93, 48: 29.01, 60: 29.20}
"""PSNR by the ring's rank and by its features: appendix E of the paper, means over Shiny-Blender."""

WARMUPS = (0.03, 0.1, 0.2, 0.3)
SCALES = (1.0, 1e2, 1e4)
SSIM_WEIGHTS = (0.0, 0.2, 0.5)

BASES = {"ringlight-paper": PAPER, "ringlight-ring": RingLightRingRecipe()}
"""Presets with a light field to study."""
BASE = "ringlight-paper"

PARETO, PARETO_BASE = "pareto", "ringlight-basis"
PARETO_BASES: dict[str, SplatRecipe] = {
    "ringlight-basis": RingLightBasisRecipe(),
    **BASES,
    "ringlight-mirror": RingLightMirrorRecipe(),
}
"""What is held against 3dgs over sizes and lengths."""

Lit = TypeVar("Lit", bound=SplatRecipe)

GRID_RATE, GRID_RATE_END = 2e-2, 2e-3
"""What TensoRF gives free values on a grid: a network's rate starves them, which is no fault of the decomposition."""

EAGER_THRESHOLD = 1e-4
"""Half of 3DGS's own: so that its number of Gaussians is bounded by what it is held against, not by the threshold."""


def study_named(name: str, base: str | None, steps: int | None) -> tuple[Variant, ...]:
    """The matrix of a study around ``base``, the unchanged base first; ``steps`` replaces the presets' own.

    Raises RecipeError for an unknown study, or a base that the study does not take.
    """
    own = base_of(name, base)
    if name == PARETO:
        variants = pareto(own, _of_length(_base(own, PARETO_BASES, "nothing to hold against 3dgs"), steps))
    elif name in STUDIES:
        variants = STUDIES[name](own, _of_length(_base(own, BASES, "no light field to study"), steps))
    else:
        near = get_close_matches(name, STUDY_NAMES, n=1)
        hint = f"perhaps you meant {near[0]!r}" if near else f"studies: {', '.join(STUDY_NAMES)}"
        raise RecipeError(f"no study is called {name!r}; {hint}")
    # Settled, or a study would not know its own runs again.
    return tuple(replace(variant, recipe=variant.recipe.at_length()) for variant in variants)


def base_of(study: str, base: str | None) -> str:
    """``base``, or the study's own."""
    return base or (PARETO_BASE if study == PARETO else BASE)


def _base(name: str, bases: Mapping[str, Lit], lacking: str) -> Lit:
    if name not in bases:
        raise RecipeError(f"--base is {name}: it has {lacking}; give {' or '.join(bases)}")
    return bases[name]


def _of_length(recipe: Lit, steps: int | None) -> Lit:
    return recipe if steps is None else replace(recipe, steps=steps)


def _ablation(base: str, recipe: RingLightRingRecipe) -> tuple[Variant, ...]:
    """Tables 2 and 3, with the controls that they lack: grids at a grid's rate, a network of the ring's size."""
    return (
        Variant(FULL, base, recipe, "unchanged", paper=29.01),
        Variant("discrete", base, _lit(recipe, field="discrete"), "w/o neural module: discrete cores", paper=27.73),
        Variant("discrete-grid-rate", base, _grid_rates(_lit(recipe, field="discrete")), "the same at a grid's rate"),
        Variant("mlp", base, _lit(recipe, field="mlp"), "w/o TR: one network", paper=26.13),
        Variant("mlp-matched", base, _matched(recipe), "w/o TR: one network of the ring's size"),
        Variant("no-base-color", base, _lit(recipe, base_color=False), "w/o base color", paper=22.85),
        Variant("no-modulation", base, _lit(recipe, light_modulation=False), "w/o light modulation", paper=28.94),
        *_controls(recipe),
    )


def _controls(recipe: RingLightRingRecipe) -> tuple[Variant, ...]:
    """3DGS as it is; with the base's pixel term, cloning what it clones; and that with no more Gaussians than the base
    ends with."""
    plain = ThreeDGSRecipe(steps=recipe.steps)
    loss = PhotometricLoss(pixel=recipe.loss.pixel, ssim_weight=recipe.loss.ssim_weight)
    same_loss = replace(plain, loss=loss, densify=replace(plain.densify, clone_below=recipe.densify.clone_below))
    eager = replace(same_loss, densify=replace(same_loss.densify, threshold=EAGER_THRESHOLD))
    return (
        Variant("3dgs", "3dgs", plain, "3DGS", paper=28.87),
        Variant("3dgs-loss", "3dgs", same_loss, f"3DGS with this loss ({loss.pixel.upper()})"),
        Variant("3dgs-equal", "3dgs", eager, "3DGS with this loss, as many Gaussians", as_many_as=FULL),
    )


def _fields(base: str, recipe: RingLightRingRecipe) -> tuple[Variant, ...]:
    """The ring beside other decompositions, which the paper does not compare; the base's own is not run twice."""
    fields = (
        ("ring", _lit(recipe, field="ring"), "neural tensor ring"),
        ("discrete-grid-rate", _grid_rates(_lit(recipe, field="discrete")), "discrete ring, grid's rate"),
        ("cp", _lit(recipe, field="cp"), "diagonal ring (CP), the ring's size"),
        ("tt", _lit(recipe, field="tt"), "open ring (tensor train)"),
        ("vm", _grid_rates(_lit(recipe, field="vm")), "planes and lines (VM), grid's rate"),
        ("mlp-matched", _matched(recipe), "one network of the ring's size"),
    )
    own = next((about for _, same, about in fields if same.light == recipe.light), f"field {recipe.light.field}")
    others = [Variant(name, base, other, about) for name, other, about in fields if other.light != recipe.light]
    return (Variant(FULL, base, recipe, own), *others)


def _varied(
    what: str,
    own: Callable[[RingLightRingRecipe], float],
    values: Mapping[Any, float | None],
    change: Callable[[RingLightRingRecipe, float], RingLightRingRecipe],
) -> Callable[[str, RingLightRingRecipe], tuple[Variant, ...]]:
    """The unchanged base at its ``own`` value, then one variant for each other of the ``values``, ascending.

    These come with what the paper reports for them.
    """

    def matrix(base: str, recipe: RingLightRingRecipe) -> tuple[Variant, ...]:
        ours = own(recipe)
        others = [
            Variant(f"{what}-{value:g}", base, change(recipe, value), f"{what} {value:g}", float(value), values[value])
            for value in sorted(values)
            if value != ours
        ]
        return (Variant(FULL, base, recipe, f"{what} {ours:g}", float(ours), values.get(ours)), *others)

    return matrix


def _scaled(recipe: RingLightRingRecipe, scale: float) -> RingLightRingRecipe:
    """The loss's scale; the densification threshold, a gradient, goes with it."""
    threshold = recipe.densify.growth(recipe.steps).threshold * scale / recipe.loss.scale
    densify = replace(recipe.densify, threshold=threshold)
    return replace(recipe, loss=replace(recipe.loss, scale=scale), densify=densify)


STUDIES: dict[str, Callable[[str, RingLightRingRecipe], tuple[Variant, ...]]] = {
    "ablation": _ablation,
    "field": _fields,
    "rank": _varied("rank", lambda r: r.light.ring.rank, PAPER_RANKS, lambda r, rank: _ringed(r, rank=int(rank))),
    "feature": _varied(
        "features", lambda r: r.light.ring.features, PAPER_FEATURES, lambda r, width: _ringed(r, features=int(width))
    ),
    "gamma": _varied("gamma", lambda r: r.loss.scale, dict.fromkeys(SCALES), _scaled),
    "beta": _varied(
        "beta",
        lambda r: r.loss.ssim_weight,
        dict.fromkeys(SSIM_WEIGHTS),
        lambda r, share: replace(r, loss=replace(r.loss, ssim_weight=share)),
    ),
    "warmup": _varied("warmup", lambda r: r.warmup, dict.fromkeys(WARMUPS), lambda r, share: replace(r, warmup=share)),
}

STUDY_NAMES = (*STUDIES, PARETO)


def _lit(recipe: RingLightRingRecipe, **changes: Any) -> RingLightRingRecipe:
    return replace(recipe, light=replace(recipe.light, **changes))


def _ringed(recipe: RingLightRingRecipe, **changes: Any) -> RingLightRingRecipe:
    return _lit(recipe, ring=replace(recipe.light.ring, **changes))


def _matched(recipe: RingLightRingRecipe) -> RingLightRingRecipe:
    return _lit(recipe, field="mlp", mlp=PerceptronSettings(hidden=0))


def _grid_rates(recipe: RingLightRingRecipe) -> RingLightRingRecipe:
    return replace(recipe, field_rate=GRID_RATE, field_rate_end=GRID_RATE_END)
