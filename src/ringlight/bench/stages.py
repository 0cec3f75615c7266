"""Where the rasterizer's time goes: ``python -m ringlight.bench.stages 100k@400 300k@800 [--threads 1]``.

Wall time by the kernels' own clock, the fastest of many rounds: on a busy machine medians would show the others.
"""

import argparse
import sys
from collections.abc import Mapping

import torch

from ringlight import _kernels
from ringlight.bench.workload import Size, workload

ROUNDS = 300


def fastest_stages(size: Size, rounds: int = ROUNDS) -> dict[str, float]:
    """Milliseconds of each stage of forward and backward on the standard workload; RGB, 3DGS's options."""
    work = workload(size)
    table = work.gaussians
    background, shape = torch.zeros(size.channels), (work.camera.height, work.camera.width)
    columns = (table.means, table.log_scales, table.quats, table.opacity_logits)
    splats = _kernels.SplatTable(*columns, None, work.channels, background)
    view = work.camera
    camera = _kernels.Pinhole(view.world_to_camera, view.focal, view.center, view.width, view.height)
    settings = _kernels.RasterSettings(0.3, 0.01, 0.999, False, False)
    image, alpha = torch.empty(size.channels, *shape), torch.empty(shape)
    means2d, radii = torch.empty(size.gaussians, 2), torch.empty(size.gaussians, 2)
    means, log_scales, quats, logits = (torch.empty_like(column) for column in columns)
    by_channels, by_means2d = torch.empty_like(work.channels), torch.empty_like(means2d)
    gradients = _kernels.SplatGradients(means, log_scales, quats, logits, None, by_channels, by_means2d, None)
    upstream, workspace = torch.ones_like(image), _kernels.Workspace()
    best: dict[str, float] = {}
    for _ in range(rounds):
        workspace.forward(splats, camera, settings, image, alpha, means2d, radii)
        workspace.backward(splats, image, upstream, None, gradients)
        for name, seconds in workspace.stage_seconds.items():
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
