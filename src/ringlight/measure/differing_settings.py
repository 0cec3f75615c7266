"""In which settings runs differ: what a comparison of them is about."""

from collections.abc import Sequence

from ringlight.core.visible_text import visible
from ringlight.core.words import counted
from ringlight.measure.report import Report

DEFAULT = "the default"

MOST_TOLD = 12
"""Settings that differ, a line each; more would hide the other notes of a table."""

LONGEST = 80
"""Characters of a value: lists of photographs have thousands."""

Labelled = tuple[str, Report, dict[str, str]]


def differing_settings(runs: Sequence[tuple[str, Report]]) -> tuple[str, ...]:
    """A line for each setting in which runs of one scene, preset and method differ, with the labels of the runs, and
    one where they are of different commits, whose defaults may differ.

    A setting that a report does not name is the preset's default. Reports that know no settings are left out.
    """
    together: dict[tuple[str, str, str], list[Labelled]] = {}
    for label, report in runs:
        if report.settings is not None:
            key = (report.scene, report.preset, report.method)
            together.setdefault(key, []).append((label, report, report.settings))
    return tuple(visible(f"{scene}: {line}") for (scene, *_), group in together.items() for line in _lines(group))


def _lines(group: Sequence[Labelled]) -> list[str]:
    lines = []
    for name in dict.fromkeys(name for *_, settings in group for name in settings):
        labels: dict[str, list[str]] = {}
        for label, _, settings in group:
            labels.setdefault(settings.get(name, DEFAULT), []).append(label)
        if len(labels) > 1:
            values = "; ".join(f"{_cut(value)} in {', '.join(which)}" for value, which in labels.items())
            lines.append(f"{name} is {values}.")
    more = len(lines) - MOST_TOLD
    lines = [*lines[:MOST_TOLD], f"and {counted(more, 'more setting')}."] if more > 0 else lines
    if len({(report.version, report.commit) for _, report, _ in group}) > 1:
        lines.append(f"{', '.join(label for label, *_ in group)} are of different commits, whose defaults may differ.")
    return lines


def _cut(value: str) -> str:
    return value if len(value) <= LONGEST else f"{value[:LONGEST]}..."
