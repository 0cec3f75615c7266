"""What shared pages cost in headless Chromium with software WebGL2, and what a picture reads from memory, counted.

    .venv/bin/python tests/page_times.py [--side 400] PAGE.html...

For each page, over several cameras at ``side`` x ``side`` pixels: milliseconds of projection, sort and tile lists in
the worker, of a whole picture until its pixels can be read, and of one in which the colours are made again; entries of
the lists, and megabytes. Then the sort of 300,000 depths alone.
"""

import argparse
import statistics
import sys
from pathlib import Path

from browsers import Tab, chromium, playwright, tab
from ringlight.files.page.document import SOURCE
from ringlight.files.page.modules import joined

REPEATS, SORTED = 3, 300_000

PICTURE = """async (side) => {
  const { viewer, facts } = window.ringlight, { picture } = viewer, gl = picture.gl;
  await window.ringlight.settled();
  const pixel = new Uint8Array(4), timed = (draw) => {
    const begun = performance.now();
    draw();
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
    return performance.now() - begun;
  };
  const drawn = timed(() => picture.draw({ ...viewer.look, some: false }));
  if (picture.kind.made) picture.kind.made = null;
  const recolored = timed(() => picture.draw({ ...viewer.look, some: false }));
  const { total, count, side: tile } = picture.lists;
  const pixels = picture.canvas.width * picture.canvas.height;
  return { ...viewer.times, drawn, recolored, total, count, tile, pixels };
}"""

SORT = """(count) => {
  const order = new $depth_order.DepthOrder(count), depths = new Float32Array(count);
  const times = [];
  for (let turn = 0; turn < 9; turn++) {
    for (let k = 0; k < count; k++) depths[k] = 1 + 5 * Math.random();
    const begun = performance.now();
    order.sort(depths, count);
    times.push(performance.now() - begun);
  }
  return times.sort((a, b) => a - b)[4];
}"""

TEXELS = {"mirror": 3, "harmonics": 1, "basis": 1, "ring": 1}
"""Texels of 16 bytes that are read of a Gaussian besides its ellipse, which is two."""


def measured(page: Tab, file: Path, side: int) -> None:
    """Print one page's row."""
    page.open(file, "#bare")
    kind = page.page.evaluate("window.ringlight.facts.kind")
    rows = []
    for turn in range(REPEATS):
        page.page.evaluate(
            "(turn) => window.ringlight.move((pose) => pose.turned(0.9 * turn, 0, [0, 0, 1], true))", turn
        )
        rows.append(page.page.evaluate(PICTURE, side))
    middle = {name: statistics.median(row[name] for row in rows) for name in rows[0]}
    entries = middle["total"]
    read = entries * (4 + 32 + 16 * TEXELS[kind]) + middle["count"] * 32 + entries * 4 + middle["pixels"] * 4
    tests = entries * middle["tile"] ** 2 / middle["pixels"]
    sys.stdout.write(
        f"{file.name}: {middle['count']:,.0f} Gaussians seen, {side}x{side}: worker {middle['project']:.1f} + "
        f"{middle['sort']:.1f} + {middle['lists']:.1f} ms, picture {middle['drawn']:.0f} ms, with colours "
        f"{middle['recolored']:.0f} ms; {entries:,.0f} entries, at most {tests:.0f} a pixel, "
        f"{read / 1e6:.1f} MB a picture\n"
    )


def main() -> None:
    """Measure what the command line names."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--side", type=int, default=400)
    parser.add_argument("pages", nargs="*", type=Path)
    asked = parser.parse_args()
    modules = {path.name: path.read_text("utf-8") for path in SOURCE.glob("*.js")}
    with playwright() as driver, chromium(driver) as browser:
        for file in asked.pages:
            with tab(browser, viewport={"width": asked.side, "height": asked.side}) as page:
                measured(page, file, asked.side)
        with tab(browser) as page:
            code = f"(() => {{ {joined(modules, 'depth_order.js')}\nreturn ({SORT})({SORTED}); }})()"
            sys.stdout.write(f"sort of {SORTED:,}: {page.page.evaluate(code):.1f} ms\n")


if __name__ == "__main__":
    main()
