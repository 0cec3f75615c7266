"""Standard output and error as every command needs them: there, of any encoding, and never a reason to end.

A training must not end because nobody reads what it says any more: the reader of a pipe leaves, a terminal is closed.
"""

import errno
import os
import re
import sys
import threading
from collections import deque
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, TextIO

LOST = frozenset({errno.EPIPE, errno.EIO, errno.EBADF, errno.ENXIO, errno.ENOTCONN, errno.ECONNRESET, errno.ESHUTDOWN})
"""What the system says where the other end of a stream is gone: pipe, terminal, file descriptor, socket."""

STANDARD = 3
"""File descriptors that belong to standard input, output and error."""


NARROWEST = 20
"""Columns; who claims fewer (``COLUMNS=0``) does not know, and the terminal is asked."""


OURS = r"\r\x1b\[2K|\x1b\[[0-9;]*m|\x1b\[\?25[lh]|\x1b\[2K|\x1b\[[0-9]*A"
"""What tables and bars write themselves: styles, the cursor shown or hidden, a line cleared, lines up."""

WIPE = "\r\x1b[2K"
"""Clears the line that the cursor is in."""

FOREIGN = re.compile(rf"({OURS})|[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")
"""Other control characters come from names in foreign files. They could rewrite the terminal, or turn its text."""


def printable(text: str, drawn: bool = False) -> str:
    """``text`` with control characters as escapes that can be read; where it is ``drawn`` on a terminal, what draws our
    tables and bars stays."""
    return FOREIGN.sub(lambda found: (drawn and found[1]) or ascii(found[0])[1:-1], text)


class Lasting:
    """A text stream that goes on into nothing once its other end is gone; else the stream itself. What is written is
    made :func:`printable`; who draws on a terminal asks for :meth:`drawing`.

    ``essential`` is one whose loss for another reason, as a full disk, is an OSError.
    """

    def __init__(self, stream: TextIO, essential: bool = True):
        self._stream, self._essential = stream, essential
        self._line = ""  # that was drawn and stands there
        self._one_at_a_time = threading.RLock()  # a clock may draw beside the command
        self._waiting: deque[Callable[[], object]] = deque()  # calls of the stream
        self._is_called = False

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        return self._put(printable(text))

    def drawing(self) -> "Drawing":
        """The same stream for tables and bars, whose texts are printable already."""
        return Drawing(self)

    def draw(self, line: str) -> None:
        """Show ``line``, which is printable, in place of the one drawn before; what is written next replaces it."""
        with self._one_at_a_time:
            self._put(line, line)
            self.flush()

    def redraw(self, before: str, line: str) -> bool:
        """The same where the line ``before`` still stands there; whether it does."""
        with self._one_at_a_time:
            stands = bool(before) and self._line == before
            if stands:
                self.draw(line)
            return stands

    def _put(self, text: str, line: str = "") -> int:
        """Write ``text``, after which the drawn ``line`` stands there."""
        self._call(partial(self._write, text, line))
        return len(text)

    def _write(self, text: str, line: str) -> None:
        wipe, self._line = WIPE if self._line else "", line
        self._stream.write(wipe + text)

    def _call(self, what: Callable[[], object]) -> None:
        """Now; or, where a signal came within a call of the stream and its handler asks, once that call is over, for a
        stream refuses to be called within its own call."""
        with self._one_at_a_time:
            self._waiting.append(what)
            while self._waiting and not self._is_called:
                self._is_called = True
                try:
                    self._waiting.popleft()()
                except OSError as error:
                    self._bear(error)
                finally:
                    self._is_called = False

    def writelines(self, lines: Any) -> None:
        for line in lines:
            self.write(line)

    def flush(self) -> None:
        self._call(self._stream.flush)

    def _bear(self, error: OSError) -> None:
        if self._essential and error.errno not in LOST:
            raise error
        self.give_up()

    def give_up(self) -> None:
        """Let what is written, and what waits to be, go nowhere."""
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self._stream.fileno())
        os.close(nowhere)


class Drawing:
    """A :class:`Lasting` stream as tables and bars need it: on a terminal their control sequences pass."""

    def __init__(self, stream: Lasting):
        self._lasting = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._lasting, name)

    def write(self, text: str) -> int:
        return self._lasting._put(printable(text, drawn=self._lasting.isatty()))


def past_bars(stream: TextIO) -> TextIO:
    """``stream`` for a signal's handler: a bar that is drawn takes its place, and a handler must not wait for the bar's
    locks."""
    proxied: TextIO = getattr(stream, "rich_proxied_file", stream)
    return proxied


def what_flushing_met() -> OSError | None:
    """Write what still waits on standard output, or give it up: what the interpreter meets last is a traceback."""
    try:
        sys.stdout.flush()
    except OSError as error:
        if isinstance(sys.stdout, Lasting):
            sys.stdout.give_up()
        return error
    return None


def lasting_streams() -> None:
    """Make standard output and error of this process so; a character that they cannot encode becomes '?', and a width
    that cannot be is forgotten."""
    _fill_descriptors()
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name) or Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115  (to the end)
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
        setattr(sys, name, Lasting(stream, essential=name == "stdout"))
    claimed = os.environ.get("COLUMNS", "")
    if not (claimed.isdecimal() and int(claimed) >= NARROWEST):
        os.environ.pop("COLUMNS", None)


def _fill_descriptors() -> None:
    """Where a parent closed one of the three, the next file that is opened would take its number, and get what is
    written to it."""
    while True:
        number = os.open(os.devnull, os.O_RDWR)
        if number >= STANDARD:
            os.close(number)
            return
        os.set_inheritable(number, True)  # a child process has three as well
