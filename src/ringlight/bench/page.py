"""What a shared page costs in a browser: its first picture, a picture of any size, the sort of its Gaussians."""

import json
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

from ringlight.bench.browser import Browser, opened_browser
from ringlight.bench.record import Circumstances
from ringlight.bench.timing import Budget
from ringlight.core.stages import tell
from ringlight.errors import BackendError
from ringlight.files.page.document import SOURCE
from ringlight.files.page.modules import joined

SORTED = 300_000
"""Depths that are sorted alone."""

SCRIPTS = Path(__file__).with_name("page_times.js")

ELLIPSE_BYTES, ENTRY_BYTES, PIXEL_BYTES, TEXEL_BYTES = 32, 4, 4, 16
"""Of a Gaussian on the screen, an entry of a tile's list, a pixel on the screen, a texel of channels."""

NOTE_FIRST = """
addEventListener("DOMContentLoaded", () => {
  window.ringlight?.ready?.then(({ viewer }) => {
    const { gl } = viewer?.picture ?? {};
    gl?.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
    window.firstPicture = performance.now();
  });
});
"""
"""Before the page's own scripts: a clock of ours would count the way to the browser. A picture is there when a pixel of
it can be read."""


@dataclass(frozen=True)
class PageRow:
    """One page at one size; milliseconds are medians over pictures from several sides."""

    name: str
    kind: str
    side: int
    """Pixels on a side."""
    bytes_page: int
    first_ms: float
    """From the page's begin to its first exact picture, inflating and compiling included."""
    seen: int
    """Gaussians that a picture shows, the median."""
    project_ms: float
    sort_ms: float
    lists_ms: float
    """The worker's part of a picture: projection, sort by depth, lists of tiles."""
    picture_ms: float
    """The graphics card's part, until a pixel can be read; colours of Gaussians as they were."""
    recolored_ms: float
    """The same with the colours of all that are seen made anew, as when the camera's position has changed."""
    pictures: int
    """That were timed."""
    entries: int
    """Of the tiles' lists."""
    tests_per_pixel: float
    """Gaussians in the lists, at most so many are looked at by a pixel, mean over pixels."""
    bytes_picture: int
    """Counted, not measured: lists, ellipses and channels that tiles read, each once for the pixels of a tile, and what
    is written."""


@dataclass(frozen=True)
class PageBench:
    """What ``ringlight bench page`` measured."""

    circumstances: Circumstances
    browser: str
    renderer: str
    """The graphics card, or the software in its place, as WebGL names it."""
    sorted: int
    sort_ms: float
    """Of so many depths in a worker, median."""
    rows: tuple[PageRow, ...]


def bench_page(
    program: str, pages: Sequence[tuple[str, Path]], sides: Sequence[int], budget: Budget, now: Circumstances
) -> PageBench:
    """Pages that `ringlight share` wrote, by their names, at every size; ``budget`` is that of each.

    Raises BackendError where the browser fails, or a page shows a still picture only.
    """
    scripts = SCRIPTS.read_text("utf-8")
    with opened_browser(program) as browser:
        browser.open("about:blank", 100, 100)
        renderer = browser.value(f"{scripts}renderer()")
        if renderer is None:
            raise BackendError(f"{program}: has no WebGL2 here; name another browser by --browser FILE")
        modules = {path.name: path.read_text("utf-8") for path in SOURCE.glob("*.js")}
        code = json.dumps(joined(modules, "depth_order.js"))
        sort_ms = float(browser.value(f"{scripts}sorted({code}, {SORTED})"))
        rows = tuple(_row(browser, scripts, name, file, side, budget) for name, file in pages for side in sides)
        return PageBench(now, browser.version, str(renderer), SORTED, sort_ms, rows)


def _row(browser: Browser, scripts: str, name: str, file: Path, side: int, budget: Budget) -> PageRow:
    tell(f"{name} at {side} x {side}")
    browser.open(f"{file.resolve().as_uri()}#bare", side, side, NOTE_FIRST)
    found = browser.value(f"{scripts}first()")
    if found is None:
        raise BackendError(f"{file}: is no page that 'ringlight share' wrote; name one, or a run")
    if found["still"] is not None:
        raise BackendError(f"{name}: the browser shows a still picture only, since {found['still']}; use another one")
    pictures, begun = [], time.monotonic()
    for turn in range(max(budget.rounds, 1)):
        if turn and time.monotonic() - begun > budget.seconds:
            break
        pictures.append(browser.value(f"{scripts}picture({turn})"))
    return _row_of(name, found, side, file.stat().st_size, pictures)


def _row_of(
    name: str, found: dict[str, Any], side: int, bytes_page: int, pictures: Sequence[dict[str, int | float]]
) -> PageRow:
    # JSON does not tell 3 from 3.0.
    middle = {key: float(median(picture[key] for picture in pictures)) for key in pictures[0]}
    entries, seen, pixels = (round(number) for number in (middle["entries"], middle["seen"], side * side))
    read = entries * (ENTRY_BYTES + ELLIPSE_BYTES + TEXEL_BYTES * found["texels"])
    written = seen * ELLIPSE_BYTES + entries * ENTRY_BYTES + pixels * PIXEL_BYTES
    return PageRow(
        name=name,
        kind=found["kind"],
        side=side,
        bytes_page=bytes_page,
        first_ms=float(found["milliseconds"]),
        seen=seen,
        project_ms=middle["project"],
        sort_ms=middle["sort"],
        lists_ms=middle["lists"],
        picture_ms=middle["drawn"],
        recolored_ms=middle["recolored"],
        pictures=len(pictures),
        entries=entries,
        tests_per_pixel=entries * middle["tile"] ** 2 / pixels,
        bytes_picture=read + written,
    )
