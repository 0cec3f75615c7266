"""What a run that was stopped still has to do, and the command that does it."""

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from ringlight.core.command_line import command
from ringlight.errors import RunError
from ringlight.runs.opened import Opened
from ringlight.runs.record import RunRecord
from ringlight.runs.relight import relights


@dataclass(frozen=True)
class StepsToGo:
    """Of a run that has not ended: the step that its model file is of, its length, and the command that goes on."""

    step: int
    planned: int
    go_on: str


def steps_to_go(opened: Opened) -> StepsToGo | None:
    """None for a run that has ended, whose record is gone, or a model file on its own."""
    if opened.run is None:
        return None
    with suppress(RunError):
        record, step = RunRecord.read(opened.run.path), opened.stored.header.step
        return StepsToGo(step, record.steps, resuming(opened.run.path, record)) if step < record.steps else None
    return None


def resuming(run: Path, record: RunRecord) -> str:
    """The command that goes on with it: one that relights writes a pack in the end."""
    return command("relight" if relights(record) else "train", "--resume", run)
