"""The runs of a table of methods: which there are, what each is asked, which are there already."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, is_dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from ringlight.data.options import SceneOptions
from ringlight.errors import RecipeError, RinglightError
from ringlight.measure.report import Report
from ringlight.methods.recipe import Recipe, recipe_from_dict
from ringlight.methods.table import method_named
from ringlight.runs.expected_time import Expected
from ringlight.runs.planned import PlannedRun, State, scenes_named, with_steps

Key = tuple[str, str, int]
"""Scene, method as the table calls it, seed."""

MOST_QUOTED = 40
"""Characters of a value that a sentence repeats: enough to find it again, and still one line."""


@dataclass(frozen=True)
class AskedMethod:
    """A column: ``name`` is the method's own, or one that was given to it with its settings."""

    name: str
    preset: str
    recipe: Recipe


@dataclass(frozen=True)
class Surveyed:
    """A run and what is there of it; ``reason`` says why it cannot go into its folder."""

    run: PlannedRun
    state: State | None
    report: Report | None = None
    reason: str | None = None


def methods_named(names: Sequence[str], settings: Sequence[str], steps: int | None) -> tuple[AskedMethod, ...]:
    """The columns: ``METHOD`` or ``NAME=METHOD``, with ``NAME.key=value`` of ``settings``.

    Raises RecipeError for an unknown method or setting, with the nearest, for two columns of one name, and for a run
    without steps.
    """
    refuse_names(names)
    asked: dict[str, AskedMethod] = {}
    for word in names:
        name, _, preset = word.partition("=")
        asked[name] = AskedMethod(name, preset or name, with_steps(method_named(preset or name), steps))
    for setting in settings:
        path, equals, value = setting.partition("=")
        name, _, key = path.partition(".")
        if not equals or not key:
            raise RecipeError(f"--set {setting}: is no METHOD.key=value, as 3dgs.densify.threshold=1e-4")
        if name not in asked:
            raise RecipeError(f"--set {setting}: {name!r} is not among --methods; it has {', '.join(asked)}")
        recipe = _with(asked[name], key, value)
        if recipe.steps < 1:
            raise RecipeError(f"--set {name}.steps is {recipe.steps}; give at least 1")
        asked[name] = replace(asked[name], recipe=recipe)
    return tuple(asked.values())


def refuse_names(words: Sequence[str]) -> None:
    """Raises RecipeError for two columns of one name, and for a name that no folder can have."""
    names: set[str] = set()
    for word in words:
        name, _, preset = word.partition("=")
        if name in names:
            raise RecipeError(f"--methods has {name!r} twice; give one of them a name: {name}-2={preset or name}")
        if not name or name in (".", "..") or "/" in name or name != name.strip():
            raise RecipeError(f"--methods: {word!r} is no METHOD and no NAME=METHOD; a name is that of a folder")
        names.add(name)


def _with(method: AskedMethod, key: str, text: str) -> Recipe:
    """The recipe with the setting at the dotted ``key``."""
    values: Any = asdict(method.recipe)
    *groups, last = (part.replace("-", "_") for part in key.split("."))
    kind, place = method.recipe, values
    for part in (*groups, last):
        known = [field.name for field in fields(kind)] if is_dataclass(kind) else []
        if part not in known:
            near = get_close_matches(part, known, n=1)
            hint = f"perhaps you meant {near[0]!r}" if near else f"there are {', '.join(known) or 'none below it'}"
            raise RecipeError(f"--set {method.name}.{key}: {method.preset} has no setting {part!r}; {hint}")
        kind = getattr(kind, part)
        if part is not last:
            place = place[part]
    place[last] = _value(text, kind)
    try:
        return recipe_from_dict(type(method.recipe), values, method.preset)
    except (RecipeError, RecursionError) as error:
        if error.__cause__ is not None:  # a rule of the settings', which has a remedy of its own
            raise RecipeError(f"--set {method.name}.{key}: {error.__cause__}") from None
        given = f"{text[:MOST_QUOTED]!r} is no value that {method.preset} takes there"
        raise RecipeError(
            f"--set {method.name}.{key}: {given}; see 'ringlight train SCENE {method.preset} --help'"
        ) from None


def _value(text: str, before: Any) -> Any:
    """``text`` as JSON, with whole numbers as floats where ``before`` is one; else ``text``, which settings that are no
    words refuse: for what is no JSON, nested too deep or too large."""
    try:
        value = json.loads(text)
        is_whole = isinstance(value, int) and not isinstance(value, bool)
        return float(value) if is_whole and isinstance(before, float) else value
    except (ValueError, OverflowError, RecursionError):
        return text


def plan(
    scenes: Sequence[Path], methods: Sequence[AskedMethod], seeds: Sequence[int], out: Path, options: SceneOptions
) -> dict[Key, Surveyed]:
    """All runs, seed by seed, so that a table stands early; each in OUT/SCENE/METHOD/seed-SEED.

    Raises RunError for what is no scene, or two of one name.
    """
    found = scenes_named(scenes)
    return {
        (name, method.name, seed): survey(
            PlannedRun(scene, method.preset, method.recipe, seed, out / name / method.name / f"seed-{seed}", options)
        )
        for seed in seeds
        for name, scene in found.items()
        for method in methods
    }


def survey(run: PlannedRun) -> Surveyed:
    """What is there of it. A folder that it cannot have is a reason, and no error: others go on."""
    try:
        run.refuse_other()
        report = run.report
        return Surveyed(run, run.state, report)
    except RinglightError as error:
        return Surveyed(run, None, reason=str(error))
    except OSError as error:
        return Surveyed(run, None, reason=f"{error.filename or run.folder}: {error.strerror}")


def order_of(run: PlannedRun, threads: int, device: str, lpips: Sequence[str]) -> dict[str, Any]:
    """What ``cli/one_run.py`` is told, plain JSON. Raises SceneError for a list of test images that cannot be read."""
    return {"run": run.to_plain(), "threads": threads, "device": device, "lpips": list(lpips)}


def expected(runs: Mapping[Key, Surveyed]) -> tuple[Expected, ...]:
    """What their time is told by; a run that cannot go into its folder takes none."""
    return tuple(
        Expected(scene, method, s.run.preset, s.run.recipe.steps, s.report, s.state in ("to do", "started"))
        for (scene, method, _), s in runs.items()
    )
