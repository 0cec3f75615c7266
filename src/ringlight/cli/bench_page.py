"""``ringlight bench page RUN ...``: what shared pages cost in a browser."""

import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from ringlight.bench.timing import Budget

if TYPE_CHECKING:
    from ringlight.bench.page import PageBench
    from ringlight.bench.record import Circumstances

LARGEST_SIDE = 4096
"""Pixels: what WebGL2 in software draws in minutes."""


@dataclass(frozen=True)
class PageCommon:
    """As of all benchmarks, but the seed: nothing is drawn by chance."""

    threads: int = 0
    """Threads of the kernels that write the pages; 0 takes every core. The browser takes what it likes."""
    rounds: int = 8
    """Pictures timed, each from another side; medians are shown."""
    seconds: float = 30.0
    """No picture of a page begins after this many seconds."""
    json: bool = False
    """Print the record as JSON instead of tables."""
    save: str | None = None
    """Write the record to benchmarks/results/SAVE.json; an earlier one is replaced."""


@dataclass(frozen=True)
class PageArguments:
    """Shared pages in a headless browser: first picture, pictures at the sizes asked, the sort of 300,000 Gaussians."""

    pages: Annotated[
        tyro.conf.Positional[tuple[Path, ...]],
        tyro.conf.arg(metavar="RUN|PAGE.html ...", help_behavior_hint="(required)"),
    ]
    """Run folders or model files, of which pages are made, or pages that 'ringlight share' wrote."""
    sides: tuple[int, ...] = (400,)
    """Pixels on a side of the pictures."""
    browser: Path | None = None
    """Chromium, Chrome or Edge; by default RINGLIGHT_CHROMIUM, or the first of their names on PATH. It draws without a
    GPU where it finds none."""
    common: Annotated[PageCommon, tyro.conf.arg(name="")] = field(default_factory=PageCommon)

    def __post_init__(self) -> None:
        from ringlight.bench.browser import find_browser
        from ringlight.errors import RecipeError, RunError

        if not self.pages:
            raise RecipeError("bench page has nothing to show; name a run folder, a model file, or a shared page")
        if not self.sides or not all(1 <= side <= LARGEST_SIDE for side in self.sides):
            raise RecipeError(f"--sides are {' '.join(map(str, self.sides))}; give one or more of 1 to {LARGEST_SIDE}")
        if missing := next((path for path in self.pages if not path.exists()), None):
            raise RunError(f"{missing}: there is no such run, model file or page; check the path")
        find_browser(self.browser)

    def measured(self, now: "Circumstances") -> "PageBench":
        """The record of what was asked for."""
        from ringlight.bench.browser import find_browser
        from ringlight.bench.page import bench_page
        from ringlight.runs.opened import open_model
        from ringlight.runs.share import SUFFIXES, share

        budget = Budget(self.common.rounds, self.common.seconds)
        with tempfile.TemporaryDirectory(prefix="ringlight-pages-") as folder:
            pages = []
            for index, path in enumerate(self.pages):
                page = path if path.suffix.lower() in SUFFIXES and path.is_file() else Path(folder, f"{index}.html")
                if page is not path:
                    share(open_model(path), page)
                pages.append((path.resolve().name, page))
            return bench_page(find_browser(self.browser), pages, self.sides, budget, now)
