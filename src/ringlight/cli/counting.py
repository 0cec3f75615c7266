"""A live count on a terminal for work of known length; silent in a log."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

Tell = Callable[[int, int], None]
"""Called with what is done and what there is in all."""


@contextmanager
def counting(label: str, quiet: bool = False) -> Iterator[Tell]:
    """Shows ``label`` and a bar on standard error while the block runs."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(bar_width=20))
    amount = TextColumn("{task.completed:.0f}/{task.total:.0f}")
    hidden = quiet or not console.is_terminal
    with Progress(*columns, amount, TimeRemainingColumn(), console=console, disable=hidden, transient=True) as bar:
        task = bar.add_task(label, total=1)
        yield lambda done, total: bar.update(task, completed=done, total=total)
