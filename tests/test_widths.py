"""Sources that no formatter looks at keep to the width of those that ruff does."""

from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
WIDTH = 120
PAGE = "src/ringlight/files/page/source/*.*"
PATTERNS = ("kernels/**/*.?pp", "scripts/*.sh", "benchmarks/*.sh", "cmake/*.*", PAGE)
SOURCES = sorted(path for pattern in PATTERNS for path in ROOT.glob(pattern))


@pytest.mark.no_kernel
def test_lines_end_within_the_width():
    assert len(SOURCES) > 50, "else this looked in the wrong place"
    wide = [
        f"{path.relative_to(ROOT)}:{number}: {len(line)} columns"
        for path in SOURCES
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1)
        if len(line) > WIDTH
    ]
    assert not wide, "\n".join(wide)
