"""In which settings runs differ: what a comparison of them is about."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from ringlight.core.visible_text import visible
from ringlight.core.words import counted
from ringlight.measure.report import GivenSetting, Report

MOST_TOLD = 12
"""Settings of one method that differ, a line each; more would hide the other notes of a table."""

LONGEST = 80
"""Characters of a value: lists of photographs have thousands."""

STEPS = "steps"
"""Told for all runs of a scene, whatever their methods."""

WORDS = {"added": "steps that --resume added"}
"""In place of a flag."""

NO_DEFAULT = ""
"""Of what every run has a number of."""


@dataclass(frozen=True)
class Labelled:
    """A run by its label in a table."""

    label: str
    report: Report


def differing_settings(runs: Sequence[tuple[str, Report]]) -> tuple[str, ...]:
    """A line each: for steps and seeds in which runs of one scene differ, then for each setting in which those of one
    method do, with the labels of the runs; where they are of different commits, whose defaults may differ; and where a
    report knows no settings and others of its method do."""
    scenes: dict[str, list[Labelled]] = {}
    for label, report in runs:
        scenes.setdefault(report.scene, []).append(Labelled(label, report))
    lines = []
    for scene, members in scenes.items():
        start = f"{scene}: " if len(scenes) > 1 else ""
        lines += [visible(f"{start}{line}") for line in _of_scene(members)]
    return tuple(lines)


def _of_scene(members: Sequence[Labelled]) -> list[str]:
    lines = [
        *_line("steps", _numbers((member.label, member.report.planned) for member in members), NO_DEFAULT),
        *_line("seeds", _numbers((member.label, member.report.seed) for member in members), NO_DEFAULT),
    ]
    methods: dict[tuple[str, str], list[Labelled]] = {}
    for member in members:
        methods.setdefault((member.report.preset, member.report.method), []).append(member)
    for group in methods.values():
        lines += _of_method(group)
    return lines


def _of_method(group: Sequence[Labelled]) -> list[str]:
    known = {member.label: member.report.settings for member in group if member.report.settings is not None}
    given: dict[str, GivenSetting] = {}
    for settings in known.values():
        given |= {name: one for name, one in settings.items() if name != STEPS and name not in given}
    lines = []
    for name, one in given.items():
        values = [
            (label, settings[name].value if name in settings else one.default) for label, settings in known.items()
        ]
        lines += _line(WORDS.get(name, "--" + name.replace("_", "-")), values, one.default)
    more = len(lines) - MOST_TOLD
    lines = [*lines[:MOST_TOLD], f"and {counted(more, 'more setting')}."] if more > 0 else lines
    if len({(member.report.version, member.report.commit) for member in group if member.label in known}) > 1:
        lines.append(f"{', '.join(known)} are of different commits, whose defaults may differ.")
    unknown = [member.label for member in group if member.label not in known]
    if known and unknown:
        lines.append(f"{', '.join(unknown)}: settings are not known.")
    return lines


def _line(name: str, values: Sequence[tuple[str, str | None]], default: str | None) -> list[str]:
    """Which runs have which value, that of the default last; no line where all have the same. None is that of a run
    which has none, where that is the default."""
    labels: dict[str | None, list[str]] = {}
    for label, value in values:
        labels.setdefault(value, []).append(label)
    if len(labels) < 2:
        return []
    usual = labels.pop(default, [])
    parts = [f"{_cut(value or 'none')} in {', '.join(own)}" for value, own in labels.items()]
    if usual:
        which = usual[0] if len(usual) == 1 else "the others"
        parts.append(f"none in {which}" if default is None else f"{_cut(default)}, the default, in {which}")
    return [f"{name}: {'; '.join(parts)}."]


def _numbers(counts: Iterable[tuple[str, int | None]]) -> list[tuple[str, str | None]]:
    """Those that are known."""
    return [(label, f"{count:,}") for label, count in counts if count is not None]


def _cut(value: str) -> str:
    return value if len(value) <= LONGEST else f"{value[: LONGEST // 2]}...{value[-LONGEST // 2 :]}"
