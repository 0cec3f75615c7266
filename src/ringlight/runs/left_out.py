"""What a table of methods is asked that is not there: columns without a method, rows without a folder.

The others go on, and the table says why these are missing: a night of runs does not wait for a slip of the pen.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from ringlight.errors import RinglightError
from ringlight.methods.table import method_named
from ringlight.runs.method_runs import Key, refuse_names
from ringlight.runs.planned import scenes_named


@dataclass(frozen=True)
class Asked:
    """The words of a command that name something, and why the others are ``left_out``, by column and by row."""

    scenes: tuple[Path, ...]
    methods: tuple[str, ...]
    settings: tuple[str, ...]
    columns_left_out: dict[str, str]
    rows_left_out: dict[str, str]

    def reasons(self, seeds: Sequence[int]) -> dict[Key, str]:
        """Why runs are missing, by run; of those that lack both the scene's."""
        rows = [*(scenes_named(self.scenes)), *self.rows_left_out]
        columns = [*map(_column, self.methods), *self.columns_left_out]
        return {
            (row, column, seed): reason
            for seed in seeds
            for row in rows
            for column in columns
            if (reason := self.rows_left_out.get(row) or self.columns_left_out.get(column))
        }


def asked_for(scenes: Sequence[Path], methods: Sequence[str], settings: Sequence[str]) -> Asked:
    """Leave out methods and scenes that there are none of, and the ``settings`` (METHOD.key=value) of such methods.

    Raises RecipeError for two columns of one name, and the first error where no method or no scene remains.
    """
    refuse_names(methods)
    presets = {word: word.partition("=")[2] or word for word in methods}
    columns = {word: wrong for word, preset in presets.items() if (wrong := _wrong(partial(method_named, preset)))}
    rows = {path: wrong for path in scenes if (wrong := _wrong(partial(scenes_named, [path])))}
    if len(columns) == len(set(methods)):
        raise columns[methods[0]]
    if len(rows) == len(set(scenes)):
        raise rows[scenes[0]]
    names = {_column(word): str(wrong) for word, wrong in columns.items()}
    there = tuple(path for path in scenes if path not in rows)
    taken = scenes_named(there)
    return Asked(
        there,
        tuple(word for word in methods if word not in columns),
        tuple(setting for setting in settings if setting.partition(".")[0] not in names),
        names,
        {str(path.absolute() if str(path) in taken else path): str(wrong) for path, wrong in rows.items()},
    )


def _wrong(ask: Callable[[], object]) -> RinglightError | None:
    """What asking raises."""
    try:
        ask()
    except RinglightError as error:
        return error
    return None


def _column(word: str) -> str:
    """NAME of NAME=METHOD, or of METHOD."""
    return word.partition("=")[0]
