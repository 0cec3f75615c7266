"""The recipe: a frozen record of settings that can build a Training. Importing recipes never imports torch."""

import dataclasses
from collections.abc import Mapping
from dataclasses import Field
from types import UnionType
from typing import (
    TYPE_CHECKING,
    Any,
    ClassVar,
    Literal,
    Protocol,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
    runtime_checkable,
)

from ringlight.core.later import came_later, value_before
from ringlight.errors import RecipeError

if TYPE_CHECKING:
    from jaxtyping import Float
    from torch import Tensor

    from ringlight.core.scene import Scene
    from ringlight.fit.train import Training
    from ringlight.methods.surface_start import SurfaceStart
    from ringlight.models.contract import Model
    from ringlight.rasterize.contract import Rasterizer


@runtime_checkable
class Recipe(Protocol):
    """One paper's settings, a frozen dataclass. Nobody asks what kind it is, nor for a setting but ``steps``,
    ``random_points`` and ``start``."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    packings: ClassVar[tuple[tuple[str, str], ...]]
    """Name patterns of tensors, and how this method's files store those that lose nothing by it:
    ``files/packing_plan.py``. Empty where all are stored as they are."""

    @property
    def steps(self) -> int:
        """The length of the run; schedules scale with it."""
        ...

    @property
    def random_points(self) -> int:
        """Random points that it starts from where a scene brings none; 0 where the photographs' size decides."""
        ...

    @property
    def start(self) -> "SurfaceStart | None":
        """Where it starts if masks cut the subject out; None where that is no setting."""
        ...

    def settled(self, scene: "Scene", rasterize: "Rasterizer", seed: int) -> "tuple[Recipe, str | None]":
        """This recipe with everything decided that it leaves to the scene, which runs and model files keep, and why."""
        ...

    def may_settle_on(self, other: "Recipe") -> bool:
        """Whether there may be a scene in which ``other`` is what this recipe is :meth:`settled` as. ``most`` aside:
        another run may set it, or this machine's memory."""
        ...

    def build(self, scene: "Scene", rasterize: "Rasterizer", seed: int) -> "Training":
        """The model at its start, and everything that trains it."""
        ...

    @property
    def most(self) -> int | None:
        """How many Gaussians (or whatever the model counts and grows) the user lets it end with; None where that is
        left to the scene, or where nothing grows."""
        ...

    def ending_with(self, most: int | None, dropping: bool = True) -> "Recipe":
        """The same with this for ``most``. Not ``dropping``: it grows to no more either, and keeps all. Itself where
        nothing grows."""
        ...

    def never_above(self, most: int) -> "Recipe":
        """The same with no more than ``most`` at any step, be some dropped later or not; itself where nothing grows."""
        ...

    def without_effect(self) -> Mapping[str, str]:
        """Settings that decide nothing as the others are, "densify.threshold", and why."""
        ...

    def model(self, box: "Float[Tensor, '2 3']", rasterize: "Rasterizer") -> "Model":
        """The model of this recipe with everything switched on, to load tensors into; ``box`` is the scene's."""
        ...

    def as_stored(self, shapes: Mapping[str, tuple[int, ...]]) -> "Recipe":
        """This recipe with a :meth:`model` for a file's tensors of these shapes; itself where training does not change
        the form of a model."""
        ...


Settings = TypeVar("Settings")


def recipe_to_dict(recipe: Recipe) -> dict[str, Any]:
    """Plain values only, as JSON gives them back."""
    plain: dict[str, Any] = _listed(dataclasses.asdict(recipe))
    return plain


def _listed(value: Any) -> Any:
    """With lists in place of tuples."""
    if isinstance(value, dict):
        return {name: _listed(inner) for name, inner in value.items()}
    return [_listed(inner) for inner in value] if isinstance(value, (list, tuple)) else value


def recipe_from_dict(kind: type[Settings], values: Any, where: str = "recipe") -> Settings:
    """Inverse of :func:`recipe_to_dict`.

    ``values`` come from a file and may be anything; one that lacks a setting of ``core/later.py`` means what there was
    before. Raises RecipeError, with ``where`` in it, for another setting that is missing or that this version does not
    know, a value of another type than the setting's, or one that a rule of the settings refuses: this is its cause.
    """
    if not isinstance(values, Mapping):
        raise RecipeError(f"{where}: is not a group of settings; {DAMAGED}")
    hints = get_type_hints(kind)
    fields = dataclasses.fields(kind)  # type: ignore[arg-type]  # of a dataclass
    known = {field.name for field in fields}
    unknown = sorted(set(values) - known)
    if unknown:
        raise RecipeError(f"{where}: unknown setting {unknown[0]!r}; it was written by another version of ringlight")
    before = {field.name: value_before(field) for field in fields if came_later(field)}
    missing = sorted(known - set(values) - before.keys())
    if missing:
        another = "it was written by another version of ringlight, or it is damaged: train again"
        raise RecipeError(f"{where}: setting {missing[0]!r} is missing; {another}")
    arguments = {name: value for name, value in before.items() if name not in values}
    for name, value in values.items():
        if dataclasses.is_dataclass(hints[name]):
            arguments[name] = recipe_from_dict(hints[name], value, f"{where}.{name}")
        elif not _fits(hints[name], value):
            raise RecipeError(f"{where}: {name} cannot be {str(value)[:40]!r}; {DAMAGED}")
        else:
            arguments[name] = tuple(value) if isinstance(value, list) else value
    try:
        return kind(**arguments)
    except RecipeError as error:
        raise RecipeError(f"{where}: {str(error).rstrip('.')}; {DAMAGED}") from error


LARGEST_WHOLE = 2**63 - 1
"""Of any setting: torch takes no more, and what is far beyond cannot even be shown as a float."""

DAMAGED = "the file is damaged: copy it again, or train again"


def _fits(hint: Any, value: Any) -> bool:
    """Whether a value from JSON has the type that a setting declares."""
    choices = get_args(hint)
    if get_origin(hint) is Literal:
        return value in choices
    if get_origin(hint) in (Union, UnionType):
        return any(_fits(choice, value) for choice in choices)
    if get_origin(hint) is tuple:
        return isinstance(value, (list, tuple)) and all(_fits(choices[0], item) for item in value)
    if isinstance(value, bool):
        return hint is bool
    if isinstance(value, int) and abs(value) > LARGEST_WHOLE:
        return False
    return isinstance(value, (int, float) if hint is float else hint)
