"""Who works with the model of a run that has steps to go is told so."""

import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ringlight.runs.opened import Opened


def tell_unfinished(opened: "Opened", quiet: bool) -> None:
    """A line on stderr where ``opened`` is of a run with steps to go; none if ``quiet``."""
    from ringlight.runs.going_on import steps_to_go

    left = steps_to_go(opened)
    if left is None or quiet:
        return
    assert opened.run is not None
    at = f"{opened.run.path}: is at step {left.step:,} of {left.planned:,}"
    sys.stderr.write(f"{at}; unless it is training now, go on with: {left.go_on}\n")
