"""``ringlight eval MODEL [SCENE]``: measure a model on held-out photographs."""

import sys
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated

import tyro

from ringlight.cli.arguments import Device, MaybeFolder, ModelPath, Net, SceneFolder
from ringlight.cli.gpu_build import tell_of_build
from ringlight.cli.parse import parse
from ringlight.data.options import ReadingOptions, SceneOptions

if TYPE_CHECKING:
    from ringlight.measure.report import Report
    from ringlight.runs.opened import Opened


@dataclass(frozen=True)
class EvalArguments:
    """Measure a model on held-out photographs: PSNR, SSIM, LPIPS, frames a second, bytes.

    A run folder is measured on its own test views. Its report.json and images/ are written again, with the numbers that
    train gave. With SCENE, or for a model file alone, nothing is written unless --out or --images asks for it.
    """

    model: ModelPath
    """Run folder or model file."""
    scene: SceneFolder = None
    """Folder of photographs; by default the model's own."""
    options: Annotated[ReadingOptions, tyro.conf.arg(name="")] = field(default_factory=ReadingOptions)
    out: MaybeFolder = None
    """New folder for report.json and images/. 'ringlight compare' reads it like a run."""
    images: MaybeFolder = None
    """New folder for the pictures alone: test/ as rendered, truth/ as photographed."""
    lpips: tuple[Net, ...] = ("alex",)
    """Networks of LPIPS. 'ringlight fetch-lpips' gets their weights."""
    device: Device = "auto"
    """Rasterizer: auto is the fastest that this machine has."""
    threads: int = 0
    """Threads of the kernels; 0 takes every core."""
    json: bool = False
    """Print the report as JSON instead of the table."""
    quiet: bool = False
    """No progress line."""


def main(arguments: list[str]) -> int:
    """Measure; returns the exit code."""
    asked = parse(EvalArguments, "eval", arguments)
    from rich.console import Console

    from ringlight.cli.threads import use_threads
    from ringlight.measure.json_record import to_json
    from ringlight.measure.table import ResultsTable
    from ringlight.runs.opened import open_model

    use_threads(asked.threads)
    tell_of_build(asked.device)
    opened = open_model(asked.model, asked.device)
    report = _measured(asked, opened)
    if asked.json:
        sys.stdout.write(to_json(report))
    else:
        Console().print(ResultsTable([(report.preset, report)]))
    return 0


def _measured(asked: EvalArguments, opened: "Opened") -> "Report":
    from ringlight.cli.counting import counting
    from ringlight.runs.finish import known_facts, measure, write_report
    from ringlight.runs.folder import RunFolder, empty_folder
    from ringlight.runs.opened import scene_of

    scene = scene_of(opened, asked.scene, SceneOptions(**vars(asked.options)))
    kept = opened.run if asked.scene is None else None
    if asked.out is not None:
        kept = RunFolder(empty_folder(asked.out))
    pictures = kept.pictures if kept else None
    if asked.images is not None:
        chosen = empty_folder(asked.images)
        pictures = chosen / "test", chosen / "truth"
    with counting(f"{opened.file}: test views", asked.quiet) as tell:
        facts, cameras = known_facts(opened), opened.stored.cameras
        report = measure(opened.stored.model, scene, facts, pictures, asked.lpips, tell, cameras)
    if kept is not None:
        write_report(kept.report, report)
        if not asked.quiet:
            sys.stderr.write(f"written to {kept.path}\n")
    return report
