"""The recipe: a frozen record of settings that can build a Training. Importing recipes never imports torch."""

import dataclasses
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Protocol, get_type_hints

from ringlight.errors import RecipeError

if TYPE_CHECKING:
    from jaxtyping import Float
    from torch import Tensor

    from ringlight.core.gaussians import Gaussians
    from ringlight.core.scene import Scene
    from ringlight.fit.train import Training
    from ringlight.models.splats import SplatModel
    from ringlight.rasterize.contract import Rasterizer


class Recipe(Protocol):
    """One paper's settings. ``steps`` is the length of the run; schedules scale with it."""

    steps: int

    def build(self, scene: "Scene", rasterize: "Rasterizer", seed: int) -> "Training":
        """The model at its start, and everything that trains it."""
        ...

    def model(self, gaussians: "Gaussians", box: "Float[Tensor, '2 3']", rasterize: "Rasterizer") -> "SplatModel":
        """The model of this recipe around a given table; ``box`` is the scene's."""
        ...


def recipe_to_dict(recipe: Any) -> dict[str, Any]:
    """Plain values only, ready for JSON."""
    return dataclasses.asdict(recipe)


def recipe_from_dict(kind: type, values: Mapping[str, Any], where: str = "recipe") -> Any:
    """Inverse of :func:`recipe_to_dict`; settings that the record lacks take their defaults.

    Raises RecipeError for a setting that this version does not know.
    """
    hints = get_type_hints(kind)
    names = [field.name for field in dataclasses.fields(kind)]
    unknown = sorted(set(values) - set(names))
    if unknown:
        raise RecipeError(f"{where}: unknown setting {unknown[0]!r}; it was written by another version of ringlight")
    arguments = {}
    for name in names:
        if name not in values:
            continue
        nested = hints[name]
        if dataclasses.is_dataclass(nested) and isinstance(nested, type):
            arguments[name] = recipe_from_dict(nested, values[name], f"{where}.{name}")
        else:
            arguments[name] = tuple(values[name]) if isinstance(values[name], list) else values[name]
    return kind(**arguments)
