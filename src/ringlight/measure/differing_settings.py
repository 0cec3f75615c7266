"""In which settings runs of one method differ: what a comparison of them is about."""

from collections.abc import Sequence

from ringlight.measure.report import Report

DEFAULT = "the default"

MOST_TOLD = 12
"""Settings that differ, a line each; runs that differ in more were not made to be compared in one."""


def differing_settings(runs: Sequence[tuple[str, Report]]) -> tuple[str, ...]:
    """A line for each setting in which runs of one scene, method and preset differ, with the labels of the runs.

    A setting that a report does not name is the preset's default, of the version that wrote it. Reports that know no
    settings are left out, and more than ``MOST_TOLD`` lines of one group end in how many more there are.
    """
    together: dict[tuple[str, str, str], list[tuple[str, dict[str, str]]]] = {}
    for label, report in runs:
        if report.settings is not None:
            together.setdefault((report.scene, report.method, report.preset), []).append((label, report.settings))
    return tuple(line for (scene, *_), group in together.items() for line in _lines(scene, group))


def _lines(scene: str, group: Sequence[tuple[str, dict[str, str]]]) -> list[str]:
    names = dict.fromkeys(name for _, settings in group for name in settings)
    lines = []
    for name in names:
        labels: dict[str, list[str]] = {}
        for label, settings in group:
            labels.setdefault(settings.get(name, DEFAULT), []).append(label)
        if len(labels) > 1:
            values = "; ".join(f"{value} in {', '.join(which)}" for value, which in labels.items())
            lines.append(f"{scene}: {name} is {values}.")
    if len(lines) > MOST_TOLD:
        return [*lines[:MOST_TOLD], f"{scene}: and {len(lines) - MOST_TOLD} more settings."]
    return lines
