"""What in a mirror's training is not of every method: rates of its light, when that is lit, what normals agree with."""

from typing import TYPE_CHECKING

from ringlight.core.gradients import SHADER
from ringlight.fit.rates import Adam, Rate
from ringlight.fit.regularizers.contract import Regularizer
from ringlight.fit.regularizers.depth_normals import DepthNormals
from ringlight.methods.assembly import Course
from ringlight.methods.three_dgs import degrees_by_step

if TYPE_CHECKING:
    from ringlight.methods.ringlight_mirror import RingLightMirrorRecipe

DECAY = 0.1
"""Rates of normals, latents and shader end at this share of their start."""

ONE_SURFACE = 0.7
"""Cosine below which blended normal and depth's normal are of two surfaces, one behind the other: pixels there have no
say. With all of them chrome lost 0.45 instead of 0.3 dB, and twelve balls gained less, when the term was asked for
during the warm-up too (docs/experiments/mirrors.md)."""


def mirror_course(recipe: "RingLightMirrorRecipe") -> Course:
    """Of a run as the recipe says."""
    first_lit = recipe.first_lit

    def lit(rate: float, hold: float = recipe.light_hold) -> Adam:
        return Adam(Rate(rate, DECAY * rate, hold), begins=first_lit)

    of_weights, of_basis, of_opacities = recipe.varying_rates
    varying = {"columns.basis_weights": lit(of_weights), "color.varying.basis": lit(of_basis)}
    if recipe.varying_opacity:
        varying["color.varying.opacity_basis"] = lit(of_opacities)
    degrees = {"color.varying.active_degree": degrees_by_step(recipe.sh_every, recipe.steps)}
    return Course(
        groups={
            "columns.base": Adam(Rate.constant(recipe.base_rate)),
            **(varying if recipe.basis_size else {}),
            "columns.normals": lit(recipe.normals_rate, hold=0.0),
            "columns.latents": lit(recipe.latents_rate),
            "shader.maps.*": lit(recipe.maps_rate),
            "shader.mlp.*": lit(recipe.network_rate),
            "shader.ring.*": lit(recipe.network_rate),
            "shader.places.*": lit(recipe.axes_rate),
            "shader.sphere": lit(recipe.sphere_rate),
        },
        unlocks={"shader.lit": {first_lit: 1}, **(degrees if recipe.basis_size else {})},
        surface_opacity=recipe.opacity,
        light=(SHADER,) if recipe.undo_collapse else (),
        first_lit=first_lit,
        regularizers=_regularizers(recipe),
    )


def _regularizers(recipe: "RingLightMirrorRecipe") -> dict[str, Regularizer]:
    if not recipe.consistency_steps:
        return {}
    weight = recipe.loss.scale * recipe.consistency
    normals = DepthNormals(weight, recipe.consistency_stride, recipe.consistency_steps, ONE_SURFACE)
    return {"consistency": normals}
