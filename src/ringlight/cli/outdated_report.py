"""A run whose own model file is replaced keeps a report of the model that was there."""

import sys
from pathlib import Path

from ringlight.core.command_line import command


def tell_outdated(model: Path) -> None:
    """A warning on stderr where ``model``, just written, is the model of a run that has a report."""
    from ringlight.runs.folder import outdated_report

    report = outdated_report(model)
    if report is not None:
        again = command("eval", model.parent)
        sys.stderr.write(f"warning: {report}: is of the model that was replaced; measure this one with: {again}\n")
