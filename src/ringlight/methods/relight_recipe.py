"""Recipes that learn only what depends on light: rates of zero for all else, and a table that keeps its rows."""

from dataclasses import replace
from typing import Any

from ringlight.errors import RecipeError
from ringlight.fit.rates import GaussianRates
from ringlight.fit.strategies.densify_settings import DensifySettings
from ringlight.methods.recipe import Recipe
from ringlight.methods.ringlight_basis import RingLightBasisRecipe
from ringlight.methods.ringlight_mirror import RingLightMirrorRecipe
from ringlight.methods.ringlight_ring import RingLightRingRecipe
from ringlight.methods.splat_recipe import SplatRecipe
from ringlight.methods.table import method_of
from ringlight.methods.volume_recipe import VolumeRecipe

FROZEN = GaussianRates(means=0.0, means_end=0.0, opacities=0.0, scales=0.0, scales_end=0.0, rotations=0.0, hold=1.0)

MAPS_RATE, NETWORK_RATE, AXES_RATE = 4e-2, 1e-2, 1e-2
"""Of a mirror: two to three times those of a whole training, for nothing else moves. After 300 steps 0.04 dB on a
recoloured toaster and 1 dB on one in another surrounding."""

BASIS_RATE = 1e-2
"""Of what a mirror's base colours share: that of short trainings, however long the model's own was."""

FIELD_RATE, FIELD_RATE_END, FIELD_EPSILON = 2e-3, 1e-4, 1e-15
"""Of a ring; the paper's constant 1e-4 gets nowhere in so few steps."""


def relight_recipe(recipe: Recipe, steps: int) -> SplatRecipe:
    """The recipe of a model with all frozen that light does not change; ``steps`` is the length of the run.

    Raises RecipeError for a method whose light is not shared, or shared otherwise.
    """
    if isinstance(recipe, RingLightMirrorRecipe):
        still = replace(
            recipe,
            **_kept(recipe, steps),
            warmup=0.0,
            base_rate=0.0,
            normals_rate=0.0,
            latents_rate=0.0,
            consistency=0.0,
            maps_rate=MAPS_RATE,
            network_rate=NETWORK_RATE,
            axes_rate=AXES_RATE,
        )
        if not recipe.basis_size:
            return still
        still = replace(still, weights_rate=0.0, basis_rate=BASIS_RATE)
        return replace(still, opacity_basis_rate=0.0) if recipe.varying_opacity else still
    if isinstance(recipe, RingLightRingRecipe):
        return replace(
            recipe,
            **_kept(recipe, steps),
            warmup=0.0,
            base_rate=0.0,
            latents_rate=0.0,
            mask_rate=0.0,
            mask_penalty=0.0,
            field_rate=FIELD_RATE,
            field_rate_end=FIELD_RATE_END,
            field_epsilon=FIELD_EPSILON,
        )
    if isinstance(recipe, RingLightBasisRecipe):
        start = replace(recipe.start, points=0)
        kept = _kept(recipe, steps)
        frozen = replace(recipe, **kept, coarse_steps=0, sh_rate=0.0, weights_rate=0.0, dropout=0.0, start=start)
        return replace(frozen, opacity_basis_rate=0.0) if recipe.varying_opacity else frozen
    method = method_of(recipe)
    if isinstance(recipe, VolumeRecipe):
        raise RecipeError(
            f"a model of {method} is a volume, whose light does not lie in a basis, a ring or a mirror of which a pack "
            "could be made; relight one of ringlight, ringlight-ring or ringlight-mirror"
        )
    raise RecipeError(
        f"the light of {method} does not lie in a basis, a ring or a mirror that its Gaussians share, of which a pack "
        f"could be made; train on the photographs from the model instead: ringlight train PHOTOS {method} --from MODEL"
    )


def _kept(recipe: SplatRecipe, steps: int) -> dict[str, Any]:
    """Settings by which every row stays as it is."""
    densify: DensifySettings = replace(
        recipe.densify, kind="adaptive", begin=0, stop=0.0, latest=0, drop_share=0.0, reset_every=0, prune_opacity=0.0
    )
    return {"steps": steps, "average": 0.0, "rates": FROZEN, "densify": densify}
