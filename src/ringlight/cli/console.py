"""Where tables and bars are drawn: what they draw with reaches the terminal, what foreign files wrote does not."""

import sys
from collections.abc import Iterable
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from ringlight.cli.streams import Lasting, printable


class Screen(Console):
    """Rich's console, of standard output or error, that shows the control characters in texts as escapes."""

    def __init__(self, stderr: bool = False):
        stream = sys.stderr if stderr else sys.stdout
        file: Any = stream.drawing() if isinstance(stream, Lasting) else stream
        super().__init__(file=file)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Rich's; the control codes that are its own come in segments of their own."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else Segment(printable(segment.text), segment.style)
