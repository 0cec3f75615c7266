"""How the training of a run went, as its folder tells it."""

from collections.abc import Sequence
from contextlib import suppress

from ringlight.errors import ModelFileError, RunError
from ringlight.files.tensor_file import read_metadata
from ringlight.measure.report import CurvePoint, read_report
from ringlight.runs.folder import RunFolder
from ringlight.runs.history import History
from ringlight.runs.record import RunRecord


def curve_of(run: RunFolder) -> Sequence[CurvePoint]:
    """Of its report, or of its newest checkpoint where that is farther: the run goes on, or was stopped. Empty where
    neither can be read."""
    reported: Sequence[CurvePoint] = ()
    with suppress(RunError):
        reported = read_report(run.path).curve
    so_far = curve_so_far(run)
    return so_far if so_far and (not reported or so_far[-1].step > reported[-1].step) else reported


def curve_so_far(run: RunFolder) -> Sequence[CurvePoint]:
    """Of the newest checkpoint that can be read; empty without one."""
    steps = 1
    with suppress(RunError):
        steps = RunRecord.read(run.path).steps
    history = History(steps)
    for checkpoint in run.checkpoints:
        with suppress(ModelFileError, ValueError):
            history.go_on_from(read_metadata(checkpoint))
            return tuple(history.points)
    return ()
