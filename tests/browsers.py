"""Pages in headless Chromium, driven by Playwright: software WebGL2, no network, a profile of their own."""

import base64
import os
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page, Playwright

NAMES = ("chromium", "chromium-browser", "google-chrome")

FLAGS = (
    "--no-sandbox",  # CI runs as root
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
"""Besides those by which Playwright keeps a browser quiet; it gives each its own profile."""

READY = "() => window.ringlight.ready.then((found) => found.still ?? 'drawn')"

VALUES = """async () => {
  await window.ringlight.settled();
  const { picture, look } = window.ringlight.viewer, bytes = new Uint8Array(picture.values(look).buffer);
  let text = "";
  for (let at = 0; at < bytes.length; at += 8192) text += String.fromCharCode(...bytes.subarray(at, at + 8192));
  return [picture.canvas.width, picture.canvas.height, btoa(text)];
}"""

LONGEST_WAIT = 20.0
"""Seconds."""

DRIVER_WORDS = "GL Driver Message"
"""Software WebGL warns that reading pixels takes long."""


def program() -> str | None:
    """The browser on this machine: on PATH, or named by RINGLIGHT_CHROMIUM."""
    named = os.environ.get("RINGLIGHT_CHROMIUM")
    return named or next((found for name in NAMES if (found := shutil.which(name))), None)


@contextmanager
def playwright() -> "Iterator[Playwright]":
    """What drives browsers; skips the test where there is none to drive."""
    api = pytest.importorskip("playwright.sync_api", reason="needs playwright (pip install '.[dev]')")
    if program() is None:
        pytest.skip("needs Chromium on PATH or in RINGLIGHT_CHROMIUM (apt-get install chromium)")
    with api.sync_playwright() as driver:
        yield driver


@contextmanager
def chromium(driver: "Playwright", *flags: str) -> "Iterator[Browser]":
    """A headless browser with these flags besides the usual ones."""
    browser = driver.chromium.launch(executable_path=program(), args=[*FLAGS, *flags])
    yield browser
    browser.close()


class Tab:
    """One page and what it complained of."""

    def __init__(self, page: "Page"):
        self.page = page
        self.complaints: list[str] = []
        self.asked: list[str] = []
        page.on("console", self._said)
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on("request", lambda request: self.asked.append(request.url))

    def _said(self, message: Any) -> None:
        if message.type in ("error", "warning") and DRIVER_WORDS not in message.text:
            self.complaints.append(message.text)

    def open(self, file: Path, address: str = "") -> str:
        """From the disk; "drawn", or why there is a still picture only."""
        self.page.goto(file.resolve().as_uri() + address)
        ready: str = self.page.evaluate(READY)
        return ready

    def values(self) -> np.ndarray:
        """The picture unrounded, [H W 3], float32, uppermost row first."""
        width, height, text = self.page.evaluate(VALUES)
        values = np.frombuffer(base64.b64decode(text), np.float32).reshape(height, width, 4)
        return np.ascontiguousarray(values[::-1, :, :3])

    def view(self, name: str) -> np.ndarray:
        """The picture of a stored camera at its own size."""
        self.page.evaluate("(name) => window.ringlight.view(name)", name)
        return self.values()

    def wait_until(self, expression: str) -> None:
        """Playwright's own waiting would need a policy that lets text be run."""
        end = time.monotonic() + LONGEST_WAIT
        while not self.page.evaluate(expression):
            assert time.monotonic() < end, f"never came true: {expression}"
            self.page.wait_for_timeout(30)

    def look(self, **change: object) -> None:
        self.page.evaluate("(change) => window.ringlight.look(change)", change)


@contextmanager
def tab(browser: "Browser", **options: object) -> Iterator[Tab]:
    """A new page in a context of its own."""
    context = browser.new_context(**({"viewport": {"width": 400, "height": 400}} | options))  # type: ignore[arg-type]
    yield Tab(context.new_page())
    context.close()
