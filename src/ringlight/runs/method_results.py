"""What a table of methods leaves behind: Markdown, LaTeX, CSV, JSON and a picture."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from ringlight.files.atomic import write_text
from ringlight.measure.json_record import to_json
from ringlight.measure.method_cells import Measured, cells_of
from ringlight.measure.method_table import MethodTable
from ringlight.measure.report import Report
from ringlight.runs.folder import make_folder
from ringlight.runs.method_charts import methods_picture
from ringlight.runs.method_runs import Key, Surveyed, survey
from ringlight.runs.sheet import write_sheet

NAME = "table"
"""Of the files, in the folder of the table."""


def method_table(runs: Mapping[Key, Surveyed], seeds: Sequence[int], failed: Mapping[Key, str]) -> MethodTable:
    """The table of what is finished on disk now; ``failed`` says why a run is not, or why there can be none."""
    reports: dict[tuple[str, str], dict[int, Report]] = {}
    reasons = dict(failed)
    for key, before in runs.items():
        now = survey(before.run)
        if now.report is not None:
            reports.setdefault(key[:2], {})[key[2]] = now.report
        elif now.reason is not None:
            reasons.setdefault(key, now.reason)
    scenes = tuple(dict.fromkeys(scene for scene, _, _ in (*runs, *failed)))
    methods = tuple(dict.fromkeys(method for _, method, _ in (*runs, *failed)))
    measured: Measured = reports
    return MethodTable(cells_of(scenes, methods, seeds, measured, reasons))


def record_of(table: MethodTable, runs: Mapping[Key, Surveyed]) -> dict[str, object]:
    """What table.json holds."""
    return {
        "measures": table.plain(),
        "notes": table.notes(),
        "runs": [
            {"scene": key[0], "method": key[1], "seed": key[2], "folder": str(surveyed.run.folder),
             "steps": surveyed.run.recipe.steps}
            for key, surveyed in runs.items()
        ],
    }  # fmt: skip


def holds_runs(out: Path) -> bool:
    """Whether earlier tables in ``out`` have a run; of those whose CSV, which has a line for each, cannot be read, this
    is taken for granted."""
    try:
        return len((out / f"{NAME}.csv").read_text(encoding="utf-8").splitlines()) > 1
    except (OSError, ValueError):
        return any(out.glob(f"{NAME}.*"))


def write_table(out: Path, table: MethodTable, runs: Mapping[Key, Surveyed], title: str) -> tuple[Path, ...]:
    """table.md, .tex, .csv, .json and .png in ``out``, in place of earlier ones. Raises OutputError."""
    make_folder(out)
    record = to_json(record_of(table, runs))
    texts = {"md": table.markdown(), "tex": table.latex(), "csv": table.csv(), "json": record}
    for suffix, text in texts.items():
        write_text(out / f"{NAME}.{suffix}", text)
    written = [out / f"{NAME}.{suffix}" for suffix in texts]
    picture = methods_picture(table.cells, title)
    if picture is not None:
        write_sheet(picture, out / f"{NAME}.png")
        written.append(out / f"{NAME}.png")
    return tuple(written)
