"""What a study leaves behind: its table as markdown, CSV and JSON, and its curves as a picture."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from ringlight.core.words import counted
from ringlight.errors import RunError
from ringlight.files.atomic import write_text
from ringlight.measure.curves import Chart, Dot, Line, draw_charts
from ringlight.measure.json_record import to_json
from ringlight.measure.report import Report
from ringlight.measure.study_table import ALL_SCENES, Label, Spread, StudyRow, StudyTable, study_rows
from ringlight.methods.variant import Variant
from ringlight.runs.pareto_charts import pareto_picture
from ringlight.runs.sheet import write_sheet
from ringlight.runs.study import StudyRun


def study_table(variants: Sequence[Variant], runs: Sequence[StudyRun]) -> StudyTable:
    """The table of the runs that are finished; empty while none is."""
    results: dict[str, dict[str, dict[int, Report]]] = {run.scene_name: {} for run in runs}
    missing: dict[str, Counter[str]] = {}
    for run in runs:
        report = run.report
        if report is None:
            missing.setdefault(run.variant.name, Counter())[run.scene_name] += 1
            continue
        if report.psnr is None:
            raise RunError(f"{run.folder}: has no test views, and a study compares on them; name some (--holdout)")
        results[run.scene_name].setdefault(run.variant.name, {})[run.seed] = report
    labels = [Label(variant.name, variant.about, variant.at, variant.paper) for variant in variants]
    rows = study_rows(labels, results)
    return StudyTable(rows, _without_mean(rows, missing) if len(results) > 1 else ())


def _without_mean(rows: Sequence[StudyRow], missing: Mapping[str, Mapping[str, int]]) -> tuple[str, ...]:
    """A sentence on variants that have rows, and none over all scenes; those that miss the same share one."""
    with_mean = {row.variant for row in rows if row.scene == ALL_SCENES}
    lacking: dict[str, list[str]] = {}
    for variant in dict.fromkeys(row.variant for row in rows if row.variant not in with_mean):
        runs = ", ".join(f"{counted(count, 'run')} of {scene}" for scene, count in missing[variant].items())
        lacking.setdefault(runs, []).append(variant)
    return tuple(
        f"Over all scenes there is no mean of {', '.join(variants)}, for want of {runs}."
        for runs, variants in lacking.items()
    )


def write_results(out: Path, study: str, base: str, runs: Sequence[StudyRun], table: StudyTable) -> tuple[Path, ...]:
    """STUDY.md, STUDY.csv, STUDY.json and STUDY.png in the study's folder, in place of earlier ones. Raises
    OutputError."""
    steps = max(run.variant.recipe.steps for run in runs)
    folders = [str(run.folder) for run in runs]
    record = {"study": study, "base": base, "steps": steps, "rows": table.rows, "notes": table.notes, "runs": folders}
    texts = {"md": table.markdown(), "csv": table.csv(), "json": to_json(record)}
    for suffix, text in texts.items():
        write_text(out / f"{study}.{suffix}", text)
    title, variants = f"{study}: {base}, {counted(steps, 'step')}", tuple(dict.fromkeys(run.variant for run in runs))
    with_curves = any(variant.curves for variant in variants)
    picture = (
        pareto_picture(variants, table.rows, title) if with_curves else draw_charts(study_charts(table.rows), title)
    )
    write_sheet(picture, out / f"{study}.png")
    return tuple(out / f"{study}.{suffix}" for suffix in (*texts, "png"))


def study_charts(rows: Sequence[StudyRow]) -> tuple[Chart, ...]:
    """PSNR, SSIM and CPU time over the number that is varied; or by variant, where a study varies no number."""
    shown = [row for row in rows if row.scene != ALL_SCENES]
    names = () if all(row.at is not None for row in shown) else tuple(dict.fromkeys(row.variant for row in shown))

    def chart(title: str, measure: str) -> Chart:
        lines = []
        for scene in dict.fromkeys(row.scene for row in shown):
            of_scene = [row for row in shown if row.scene == scene]
            lines.append(Line(scene, tuple(_dot(row, getattr(row, measure), names) for row in of_scene)))
        return Chart(title, tuple(lines), names)

    return chart("PSNR, dB", "psnr"), chart("SSIM", "ssim"), chart("training, core seconds", "core_seconds")


def _dot(row: StudyRow, value: Spread, names: tuple[str, ...]) -> Dot:
    place = names.index(row.variant) if names else row.at
    return Dot(float(place or 0), value.mean, value.deviation)
