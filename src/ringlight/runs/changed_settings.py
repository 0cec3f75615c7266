"""What a run was given: settings that are not the defaults of its method, or of how a scene is read."""

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ringlight.data.options import SceneOptions
from ringlight.measure.report import GivenSetting
from ringlight.methods.recipe import Recipe
from ringlight.methods.table import METHODS, method_of
from ringlight.runs.folder import MODEL_NAME
from ringlight.runs.record import RunRecord
from ringlight.runs.starting_points import with_points_of

OPEN = "left open"
"""A default that the length of the run, or the scene, decides."""


@dataclass(frozen=True)
class Setting:
    """One that differs: its dotted name, its value, and the default of its method."""

    name: str
    value: Any
    default: Any

    @property
    def words(self) -> tuple[str, ...]:
        """Of the command line; none for a value that it cannot say, which leaves a default open."""
        flag = self.name.replace("_", "-")
        if self.value is None:
            return ()
        if isinstance(self.value, bool):
            *group, last = flag.split(".")
            return ("--" + ".".join([*group, last if self.value else f"no-{last}"]),)
        values = self.value if isinstance(self.value, tuple) else (self.value,)
        return (f"--{flag}", *map(str, values))


def written(value: Any) -> str:
    """A setting's value for a person; a whole number is written alike whether it is kept as a float or not."""
    if value is None:
        return OPEN
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, float) and value.is_integer():
        return str(value).removesuffix(".0")
    if isinstance(value, tuple):
        return " ".join(f"{each:.5g}" if isinstance(each, float) else str(each) for each in value)
    return str(value)


def settings_changed(record: RunRecord) -> list[Setting]:
    """What of the recipe is not its method's default: by a flag, or because the scene or the length decided it."""
    return _differences(_default(record), record.recipe)


def options_changed(record: RunRecord) -> list[Setting]:
    """How the scene was read for training, where that is not the method's default."""
    return _differences(with_points_of(_default(record), SceneOptions()), record.options)


def settings_by_name(record: RunRecord) -> dict[str, GivenSetting]:
    """What of a training was no default, for a report: the recipe, how the scene was read, the steps by which it was
    extended ("added") and the model that it started from ("from"), without the folders above it.

    What only bounds memory is left out.
    """
    changed = [*settings_changed(record), *options_changed(record)]
    found = {
        one.name: GivenSetting(written(one.value), written(one.default))
        for one in changed
        if one.name != "photo_memory"
    }
    if record.added:
        found["added"] = GivenSetting(" ".join(map(str, record.added)))
    if record.start is not None:
        found["from"] = GivenSetting(_named(Path(record.start)))
    return found


def _named(start: Path) -> str:
    """A run by its folder, another file by its own name."""
    return start.parent.name if start.name == MODEL_NAME and start.parent.name else start.name


def method_asked(preset: str, recipe: Recipe) -> str:
    """The method whose flags can say this recipe: the preset, or what a chooser settled on."""
    named = METHODS.get(preset)
    return preset if type(named) is type(recipe) else method_of(recipe)


def _default(record: RunRecord) -> Recipe:
    return METHODS[method_asked(record.preset, record.recipe)]


def _differences(default: Any, value: Any, group: str = "") -> list[Setting]:
    """Field by field of two records of one kind, in their order."""
    found: list[Setting] = []
    for field in dataclasses.fields(default):
        name, before, now = group + field.name, getattr(default, field.name), getattr(value, field.name)
        if dataclasses.is_dataclass(before) and type(before) is type(now):
            found += _differences(before, now, f"{name}.")
        elif before != now:
            found.append(Setting(name, now, before))
    return found
