"""What one run states about itself: how it was made, on what machine, with which settings, and how to repeat it."""

from collections.abc import Sequence

import ringlight
from ringlight.core.words import MEGABYTE
from ringlight.measure.machine import source_commit
from ringlight.measure.report import Report
from ringlight.pages.markup import Html, element, joined, name
from ringlight.pages.report.charts import dot
from ringlight.pages.report.groups import Member
from ringlight.pages.report.repeated import commands
from ringlight.runs.changed_settings import options_changed, settings_changed, written


def run_facts(member: Member, label: str) -> Html:
    """The section of one run; its troubles stand with its scene. ``label`` tells it from the runs of all scenes."""
    run = member.run
    parts = [element("h3", dot(member.index), name(label))]
    if run.report is not None:
        parts.append(_made(run.report))
    parts += [_settings(member), _repeat(member)]
    if run.report is not None:
        parts.append(_bytes(run.report))
    return element("section", *parts, class_="run")


def _made(report: Report) -> Html:
    machine = report.machine
    cores = f"{machine.cores} cores, {machine.threads} threads, {machine.isa}"
    steps = "-" if report.iterations is None else f"{report.iterations:,}"
    if report.planned is not None and report.planned != report.iterations:
        steps += f" of {report.planned:,}"
    rows = [
        (
            "method",
            report.method if report.method == report.preset else f"{report.method}, asked for as {report.preset}",
        ),
        ("steps", f"{steps}, seed {'-' if report.seed is None else report.seed}"),
        ("scene", f"{report.scene} ({report.dataset}), {report.split}, {report.resolution}, {report.background}"),
        *(("", note) for note in report.notes),
        (
            "speed of pictures",
            f"{report.fps:.1f} a second: {report.fps_note}" if report.fps else report.fps_note or "-",
        ),
        ("machine", f"{machine.cpu}, {cores}, {machine.gpu or 'no GPU'}, {machine.system}"),
        ("software", f"ringlight {report.version}, Python {machine.python}, torch {machine.torch}"),
        ("commit", report.commit or "of an installed copy, which knows none"),
    ]
    return pairs(rows)


def pairs(rows: Sequence[tuple[str, str]]) -> Html:
    """Labels and what they stand for."""
    return element("dl", *(element("div", element("dt", label), element("dd", name(text))) for label, text in rows))


def _settings(member: Member) -> Html:
    record = member.run.record
    if record is None:
        return element("p", "Its settings are not known: recipe.json is missing or damaged.", class_="faint")
    changed = [*settings_changed(record), *options_changed(record)]
    title = element("h4", "Settings that differ from the defaults")
    if not changed:
        return joined([title, element("p", "None.", class_="faint")])
    head = element("tr", *(element("th", text) for text in ("setting", "here", "default")))
    rows = [
        element("tr", *(element("td", name(text)) for text in (one.name, written(one.value), written(one.default))))
        for one in changed
    ]
    about = "By a flag, or because the length of the run or the scene decided what is left open."
    table = element("div", element("table", head, *rows, class_="settings"), class_="wide")
    return joined([title, table, element("p", about, class_="faint")])


def _repeat(member: Member) -> Html:
    record = member.run.record
    if record is None:
        return Html("")
    here = f"For ringlight {ringlight.__version__}, whose defaults it leaves out."
    report = member.run.report
    same = record.version == ringlight.__version__ and (report is None or report.commit == source_commit())
    note = "The same seed on the same kind of machine gives the same bits."
    if not same:
        made = f"ringlight {record.version}" + (f", commit {report.commit}" if report and report.commit else "")
        note = f"The run was made by {made}: defaults and bits may differ."
    note = f"{here} {note}"
    code = [element("pre", element("code", line)) for line in commands(record)]
    return joined([element("h4", "How to repeat it"), *code, element("p", note, class_="faint")])


def _bytes(report: Report) -> Html:
    rows = [
        element("tr", element("td", name(part)), element("td", f"{size / MEGABYTE:,.3f}", class_="number"))
        for part, size in sorted(report.bytes_by_part.items(), key=lambda item: -item[1])
    ]
    total = element("tr", element("th", "all"), element("th", f"{report.bytes_raw / MEGABYTE:,.3f}", class_="number"))
    table = element("table", *rows, total, class_="settings")
    return element("details", element("summary", "What the raw megabytes are"), table)
