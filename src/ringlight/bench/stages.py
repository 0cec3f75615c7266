"""Where the rasterizer's time goes: ``python -m ringlight.bench.stages 100k@400 300k@800 [--threads 1]``.

Wall time by the kernels' own clock, the fastest of many rounds: on a busy machine medians would show the others.
"""

import argparse
import sys
from collections.abc import Mapping

from ringlight import _kernels
from ringlight.bench.raster import OneView
from ringlight.bench.workload import Size, workload
from ringlight.rasterize.cpu import CpuRasterizer

ROUNDS = 300


def fastest_stages(size: Size, rounds: int = ROUNDS) -> dict[str, float]:
    """Milliseconds of each stage of forward and backward on the standard workload, default options."""
    view, best = OneView(workload(size), rasterizer := CpuRasterizer()), dict[str, float]()
    for _ in range(rounds):
        view.forward()
        view.backward()
        for name, seconds in rasterizer.spare[-1].stage_seconds.items():
            best[name] = min(best.get(name, seconds * 1e3), seconds * 1e3)
    return best


def line(name: str, stages: Mapping[str, float]) -> str:
    """One row of a Markdown table, milliseconds."""
    return f"| {name} | " + " | ".join(f"{ms:.2f}" for ms in [*stages.values(), sum(stages.values())]) + " |\n"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sizes", nargs="+", help="Gaussians@pixels, as in 100k@400")
    parser.add_argument("--threads", type=int, default=0)
    asked = parser.parse_args()
    _kernels.set_threads(asked.threads)
    for number, text in enumerate(asked.sizes):
        stages = fastest_stages(Size.parse(text))
        if number == 0:
            title = f"{_kernels.isa()}, {_kernels.threads()} threads, ms"
            sys.stdout.write(f"| {title} | " + " | ".join([*stages, "sum"]) + " |\n")
            sys.stdout.write("|---" * (len(stages) + 2) + "|\n")
        sys.stdout.write(line(text, stages))


if __name__ == "__main__":
    main()
