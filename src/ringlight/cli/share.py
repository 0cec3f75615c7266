"""``ringlight share MODEL OUT.html``: the model itself as one page for any browser."""

import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from ringlight.cli.arguments import ModelPath
from ringlight.cli.parse import parse
from ringlight.cli.stages import stages
from ringlight.cli.threads import check_threads, use_threads
from ringlight.cli.unfinished import tell_unfinished
from ringlight.core.words import MEGABYTE, counted, numbered

if TYPE_CHECKING:
    from ringlight.runs.share import Shared


@dataclass(frozen=True)
class ShareArguments:
    """Write a model as one HTML file that any browser with WebGL2 opens, from a disk or a server, without a network.

    The page shows the model itself, its light and its reflections, not harmonics fitted to it. It holds the numbers
    that 'ringlight compress' writes, and the loss of that is printed. OUT.html#view=train-0 shows a training camera at
    its own size, &bare without controls.
    """

    model: ModelPath
    """Run folder or model file."""
    out: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="OUT.html")]
    """Page to write."""
    budget: Annotated[float | None, tyro.conf.arg(metavar="MB")] = None
    """Largest size of the page in megabytes. Gaussians that show least to the training cameras are left out until it
    fits. Without it a page of more than 40 MB is refused."""
    light: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="PACK…")] = ()
    """Light packs of this model, or folders that 'ringlight relight' wrote. The page then has a slider that blends
    between the model's own light and that of a pack."""
    overwrite: bool = False
    """Replace the file if it exists."""
    threads: int = 0
    """Threads of the kernels; 0 takes every core."""
    json: bool = False
    """Print the result as JSON."""
    quiet: bool = False
    """No progress line."""


def main(arguments: list[str]) -> int:
    """Share; returns the exit code."""
    asked = parse(ShareArguments, "share", arguments)
    check_threads(asked.threads)
    with stages(asked.quiet) as line:
        line(f"reading {asked.model}")
        from ringlight.measure.json_record import to_json
        from ringlight.runs.light_pack import read_pack
        from ringlight.runs.opened import open_model
        from ringlight.runs.share import check_target, share

        check_target(asked.out, asked.overwrite)
        use_threads(asked.threads)
        packs = [read_pack(path) for path in asked.light]
        budget = None if asked.budget is None else asked.budget * MEGABYTE
        opened = open_model(asked.model)
        tell_unfinished(opened, asked.quiet)
        shared = share(opened, asked.out, budget, packs)
    sys.stdout.write(to_json(shared) if asked.json else _sentences(shared, [pack.scene for pack in packs]))
    return 0


def _sentences(shared: "Shared", lights: list[str]) -> str:
    left_out = shared.counted_before - shared.counted
    lines = [
        f"{shared.file}: {numbered(shared.counted, shared.noun)}, {shared.bytes_file / MEGABYTE:.3f} MB; "
        "open it in a browser",
        f"  its pictures against the model's, from {counted(shared.pictures, 'training camera')}: "
        f"{_nearness(shared.picture_psnr)}",
    ]
    if left_out:
        lines.insert(1, f"  {numbered(left_out, shared.noun)} that show least were left out")
    if lights:
        lines.append(f"  its slider blends to the light of {', '.join(lights)}")
    return "\n".join(lines) + "\n"


def _nearness(decibels: float) -> str:
    return f"{decibels:.1f} dB PSNR" if math.isfinite(decibels) else "no difference"
