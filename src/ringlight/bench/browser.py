"""A headless Chromium, driven through its debugging pipe: no further library, no port.

The browser reads commands from its file 3 and answers on its file 4, JSON messages with a zero byte behind each (Chrome
DevTools Protocol, ``--remote-debugging-pipe``). What is run in a page this way is no script of the page, so that its
policy has no say in it.
"""

import json
import os
import select
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from ringlight.errors import BackendError

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "microsoft-edge")
NAMED_BY = "RINGLIGHT_CHROMIUM"
"""Environment variable that names the program."""

FLAGS = (
    "--headless",
    "--remote-debugging-pipe",
    "--enable-unsafe-swiftshader",  # without a GPU: WebGL in software, which is refused otherwise
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)

LONGEST_WAIT = 300.0
"""Seconds for one answer: software WebGL takes tens of seconds for a large picture."""

PATIENCE = 20.0
"""Seconds for a browser to end."""

LAUNCH = """
import fcntl, os, sys
ends = [fcntl.fcntl(int(end), fcntl.F_DUPFD, 10) for end in sys.argv[1:3]]
os.dup2(ends[0], 3), os.dup2(ends[1], 4)
os.execv(sys.argv[3], sys.argv[3:])
"""
"""Puts the pipes where the browser looks for them: a child's files can be given, but not their numbers."""


def find_browser(named: Path | None = None) -> str:
    """The program ``named``, or by RINGLIGHT_CHROMIUM, or of the usual name on PATH. Raises BackendError for none."""
    asked = str(named) if named is not None else os.environ.get(NAMED_BY)
    found = next((path for name in ([asked] if asked else NAMES) if (path := shutil.which(name))), None)
    if found is None:
        what = f"{asked} is no program that can be run" if asked else "there is no Chromium on PATH"
        raise BackendError(f"{what}; install Chromium or Chrome, or name one by --browser FILE")
    return found


class Browser:
    """One that runs; see :func:`opened_browser`."""

    def __init__(self, program: str, commands: int, answers: int):
        self.program, self._commands, self._answers = program, commands, answers
        self._heard, self._count = b"", 0
        self._target: str | None = None
        self._session: str | None = None
        self.version: str = self._ask("Browser.getVersion")["product"]

    def open(self, address: str, width: int, height: int, before: str = "") -> None:
        """A new page in the place of the one before, in a window of so many pixels; returns when it was loaded. The
        script ``before`` runs before its own."""
        if self._target is not None:
            self._ask("Target.closeTarget", targetId=self._target)
        self._target = self._ask("Target.createTarget", url="about:blank")["targetId"]
        self._session = self._ask("Target.attachToTarget", targetId=self._target, flatten=True)["sessionId"]
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self._ask("Emulation.setDeviceMetricsOverride", **size)
        self._ask("Page.enable")
        self._ask("Page.addScriptToEvaluateOnNewDocument", source=before)
        if address != "about:blank":
            self._ask("Page.navigate", url=address)
            self._until(lambda message: message.get("method") == "Page.loadEventFired")

    def value(self, expression: str) -> Any:
        """Of JavaScript in the page, or what its promise is kept with. Raises BackendError where it throws."""
        found = self._ask("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in found:
            details = found["exceptionDetails"]
            said = details.get("exception", {}).get("description", details.get("text", ""))
            raise BackendError(f"{self.program}: the page failed: {said.splitlines()[0] if said else 'no reason'}")
        return found["result"].get("value")

    def _ask(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._count += 1
        message: dict[str, Any] = {"id": self._count, "method": method, "params": parameters}
        if self._session is not None and not method.startswith(("Browser.", "Target.")):
            message["sessionId"] = self._session
        try:
            os.write(self._commands, json.dumps(message).encode() + b"\0")
        except OSError:
            raise self._gone() from None
        answer = self._until(lambda message: message.get("id") == self._count)
        if "error" in answer:
            raise BackendError(f"{self.program}: refuses {method}: {answer['error'].get('message')}; use another one")
        result: dict[str, Any] = answer["result"]
        return result

    def _until(self, wanted: Any) -> dict[str, Any]:
        """The next message that is ``wanted``; others are passed over."""
        end = time.monotonic() + LONGEST_WAIT
        while True:
            while b"\0" in self._heard:
                text, self._heard = self._heard.split(b"\0", 1)
                message: dict[str, Any] = json.loads(text)
                if wanted(message):
                    return message
            ready, _, _ = select.select([self._answers], [], [], max(end - time.monotonic(), 0.0))
            if not ready:
                waited = f"has not answered for {LONGEST_WAIT:.0f} seconds"
                raise BackendError(f"{self.program}: {waited}; ask for smaller pictures")
            more = os.read(self._answers, 1 << 16)
            if not more:
                raise self._gone()
            self._heard += more

    def _gone(self) -> BackendError:
        return BackendError(f"{self.program}: has ended before it answered; run it by itself to see why")


@contextmanager
def opened_browser(program: str) -> Iterator[Browser]:
    """It runs with a profile of its own, which is gone afterwards. Raises BackendError where it does not start."""
    to_read, to_write = os.pipe()
    from_read, from_write = os.pipe()
    # Chromium's sandbox refuses to be started by root, as whom containers run.
    flags = [*FLAGS, "--no-sandbox"] if os.geteuid() == 0 else FLAGS
    with tempfile.TemporaryDirectory(prefix="ringlight-browser-", ignore_cleanup_errors=True) as profile:
        line = [sys.executable, "-c", LAUNCH, str(to_read), str(from_write), program, *flags]
        try:
            process = subprocess.Popen(
                [*line, f"--user-data-dir={profile}", "about:blank"],
                pass_fds=(to_read, from_write),
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
            os.close(to_read)
            os.close(from_write)
            try:
                yield Browser(program, to_write, from_read)
            finally:
                _end(process, to_write)
        finally:
            for end in (to_write, from_read):
                os.close(end)


def _end(process: "subprocess.Popen[bytes]", commands: int) -> None:
    """By its own command, so that its helpers end too."""
    with suppress(OSError):
        os.write(commands, b'{"id":0,"method":"Browser.close"}\0')
    try:
        process.wait(PATIENCE)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
