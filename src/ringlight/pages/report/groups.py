"""Which runs stand side by side: those of one scene that were measured on the same photographs."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from ringlight.errors import RunError
from ringlight.measure.compare import ComparedRun, refuse_other_views
from ringlight.pages.report.gathered import GatheredRun


@dataclass(frozen=True)
class Member:
    """A run with its name on the page and the number of its colour."""

    label: str
    index: int
    run: GatheredRun


@dataclass(frozen=True)
class Group:
    """``why_apart``: a sentence where runs of the scene stand in another group."""

    scene: str
    members: tuple[Member, ...]
    why_apart: str | None = None

    @property
    def measured(self) -> tuple[tuple[Member, ComparedRun], ...]:
        """Those that have a report."""
        found = ((member, member.run.folder, member.run.report) for member in self.members)
        return tuple((member, ComparedRun(folder, report)) for member, folder, report in found if report)


def grouped(runs: Sequence[GatheredRun]) -> tuple[Group, ...]:
    """By scene in the order of the runs. A run that does not compare with the first of its scene stands in a group of
    its own, with the reason."""
    scenes: dict[str, list[GatheredRun]] = {}
    for run in runs:
        scenes.setdefault(run.scene, []).append(run)
    of_scenes = {
        scene: [Member(label, index, run) for index, (label, run) in enumerate(zip(_labels(of), of, strict=True))]
        for scene, of in scenes.items()
    }
    return tuple(group for scene, members in of_scenes.items() for group in _groups(scene, members))


def _groups(scene: str, members: Sequence[Member]) -> list[Group]:
    groups: list[list[Member]] = []
    reasons: list[str | None] = []
    for member in members:
        reason = None
        for group in groups:
            reason = _why_not_beside(group, member)
            if reason is None:
                group.append(member)
                break
        else:
            groups.append([member])
            reasons.append(reason)
    return [Group(scene, tuple(group), reason) for group, reason in zip(groups, reasons, strict=True)]


def _why_not_beside(group: Sequence[Member], member: Member) -> str | None:
    first = next((other.run for other in group if other.run.report), None)
    if first is None or first.report is None or member.run.report is None:
        return None
    try:
        refuse_other_views(ComparedRun(first.folder, first.report), ComparedRun(member.run.folder, member.run.report))
    except RunError as error:
        return str(error)
    return None


def _labels(runs: Sequence[GatheredRun]) -> list[str]:
    """The shortest names that tell the runs of a scene apart: what was asked for, else the folder, else its path."""
    candidates = (
        [run.preset for run in runs],
        [" ".join(dict.fromkeys((run.preset, run.folder.resolve().name))) for run in runs],
        [str(run.folder.resolve()) for run in runs],
    )
    return next(names for names in candidates if max(Counter(names).values()) == 1)
