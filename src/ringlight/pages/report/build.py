"""``ringlight report``: from run folders to one page."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import ringlight
from ringlight.core import stages
from ringlight.core.visible_text import visible
from ringlight.core.words import counted
from ringlight.errors import RunError
from ringlight.files.atomic import write_text
from ringlight.measure.lpips_notes import stored_lpips_notes
from ringlight.measure.table import ResultsTable
from ringlight.pages.document import document
from ringlight.pages.markup import Html, element, name
from ringlight.pages.report import sections
from ringlight.pages.report.facts import run_facts
from ringlight.pages.report.gathered import GatheredRun, gathered
from ringlight.pages.report.groups import Group, Member, grouped
from ringlight.pages.report.layers import layers_shown
from ringlight.pages.report.views import MOST_BYTES, views_shown

SOURCES = "ringlight.pages.report"

VIEWS = 6
"""Test views of each scene that are shown, unless somebody asks for another number."""


@dataclass(frozen=True)
class WrittenReport:
    """The page's ``bytes``; ``notes`` say what it does not show, and why."""

    file: Path
    bytes: int
    runs: tuple[GatheredRun, ...]
    labels: tuple[str, ...]
    notes: tuple[str, ...]


def write_report_page(
    folders: Sequence[Path], out: Path, views: int = VIEWS, with_layers: bool = True
) -> WrittenReport:
    """Write one page about the runs in these folders; one that is named twice counts once.

    Raises RunError for no folder at all, or one that holds no run; OutputError where the page cannot be written.
    """
    named = list({folder.resolve(): folder for folder in folders}.values())
    if not named:
        raise RunError("no runs are named; give the folders that 'ringlight train' wrote")
    groups = grouped([gathered(folder) for folder in named])
    body, notes = _body(groups, views, with_layers)
    members = [member for group in groups for member in group.members]
    title = f"{', '.join(dict.fromkeys(group.scene for group in groups))}: {', '.join(m.label for m in members)}"
    text = document(SOURCES, title, body)
    write_text(out, text)
    runs, labels = tuple(member.run for member in members), tuple(member.label for member in members)
    return WrittenReport(out, len(text.encode()), runs, labels, notes)


def _body(groups: Sequence[Group], views: int, with_layers: bool) -> tuple[Html, tuple[str, ...]]:
    members = [member for group in groups for member in group.members]
    notes = [trouble for member in members for trouble in member.run.troubles]
    parts = [_header(groups, members)]
    for number, group in enumerate(groups):
        scene, of_scene = _scene(group, f"s{number}", views, with_layers, MOST_BYTES // len(groups))
        parts.append(scene)
        notes += of_scene
    parts.append(element("h2", "Runs", id="runs"))
    several = len({group.scene for group in groups}) > 1
    parts += [
        run_facts(member, f"{group.scene}: {member.label}" if several else member.label)
        for group in groups
        for member in group.members
    ]
    footer = (
        f"Written by ringlight {ringlight.__version__}. Pictures are at most 800 pixels wide or high and lossy (WebP); "
    )
    footer += "the measured ones lie in the run folders, in images/. This file loads nothing from a network."
    parts.append(element("footer", element("p", footer)))
    return element("main", *parts), tuple(dict.fromkeys(notes))


def _header(groups: Sequence[Group], members: Sequence[Member]) -> Html:
    scenes = list(dict.fromkeys(group.scene for group in groups))
    links = [element("a", name(group.scene), href=f"#s{number}") for number, group in enumerate(groups)]
    about = f"{counted(len(members), 'run')} of {counted(len(scenes), 'scene')}"
    jump = element("nav", *links, element("a", "how they were made", href="#runs"))
    return element(
        "header",
        element("p", "ringlight report", class_="kind"),
        element("h1", name(", ".join(scenes))),
        element("p", about, class_="faint"),
        jump,
    )


def _scene(group: Group, key: str, views: int, with_layers: bool, room: int) -> tuple[Html, list[str]]:
    stages.tell(f"reading pictures of {visible(group.scene)}")
    shown = views_shown(group, views, room)
    notes = list(shown.notes)
    parts = [element("h2", name(group.scene), id=key)]
    if group.why_apart:
        notes.append(f"{group.why_apart}.")
        parts.append(element("p", f"Apart from the others of this scene: {group.why_apart}.", class_="trouble"))
    parts += [element("p", trouble, class_="trouble") for member in group.members for trouble in member.run.troubles]
    measured = [(member.label, run.report) for member, run in group.measured]
    if measured:  # of this group alone: others were measured on other photographs, and no best goes across
        lpips = stored_lpips_notes([report for _, report in measured])
        parts.append(sections.table(ResultsTable(measured, measured[0][0], lpips)))
    parts += [element("h3", "How training went"), sections.trainings(group, key)]
    if group.measured:
        parts.append(sections.view_cards(group, shown, f"{key}-views"))
    if with_layers:
        stages.tell(f"drawing layers of {visible(group.scene)}")
        pictures, troubles = layers_shown(group)
        notes += troubles
        parts.append(sections.layers(pictures, troubles))
    return element("section", *parts, class_="scene"), notes
