"""How many random points a run starts from, where its scene brings none: what the user, or else the method says."""

from dataclasses import replace

from ringlight.data.options import SceneOptions
from ringlight.methods.recipe import Recipe


def with_points_of(recipe: Recipe, options: SceneOptions) -> SceneOptions:
    """``options`` with the method's number, unless they state one or the method leaves it to the photographs' size."""
    if options.initial_points is not None or not recipe.random_points:
        return options
    return replace(options, initial_points=recipe.random_points)
