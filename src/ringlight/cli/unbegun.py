"""A run that was interrupted before its first step: what goes on with it."""

import sys
from pathlib import Path

from ringlight.cli.main import Stopped
from ringlight.cli.signals import signal_of
from ringlight.core.command_line import command


def stopped_unbegun(
    interruption: KeyboardInterrupt, verb: str, out: Path | None, from_model: bool, anew: str
) -> Stopped:
    """Says that it was, and what ``verb`` does next; ``out`` is where it was to be, ``anew`` how another place is
    named."""
    sys.stderr.write(f"ringlight: interrupted before the first step; {_way_on(verb, out, from_model, anew)}\n")
    return Stopped(signal_of(interruption))


def _way_on(verb: str, out: Path | None, from_model: bool, anew: str) -> str:
    """The run may have its folder already."""
    from ringlight.runs.folder import RunFolder

    folder = None if out is None else RunFolder(out)
    if folder is None or not folder.recorded:
        return "the same command begins again"
    if from_model and not folder.checkpoints:  # without which nobody knows what it starts from
        return f"{folder.path} holds nothing to go on from: begin again with {anew}"
    return f"go on with: {command(verb, '--resume', folder.path)}"
