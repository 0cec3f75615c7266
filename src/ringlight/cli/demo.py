"""``ringlight demo``: two methods on a bundled scene, one table, one picture, and what to do next."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from ringlight.cli.arguments import MaybeFolder
from ringlight.cli.loading import telling_of_scenes
from ringlight.cli.parse import parse
from ringlight.cli.run_length import check_length
from ringlight.cli.run_training import RunOptions, train_and_measure
from ringlight.cli.stages import stages
from ringlight.cli.threads import check_threads, use_threads
from ringlight.core.command_line import command
from ringlight.errors import RecipeError

if TYPE_CHECKING:
    from ringlight.runs.demo import Demo

STEPS = 3000
"""Both methods together stay below four minutes on two cores."""


@dataclass(frozen=True)
class DemoArguments:
    """Train 3dgs and ringlight on a bundled scene, and compare them on views that neither has seen.

    Ctrl-C finishes the step and saves; 'ringlight demo --resume FOLDER' goes on from there.
    """

    scene: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="[toaster|carpaint]")] = "toaster"
    """toaster (chrome) or carpaint (clear coat)."""
    steps: int = STEPS
    """Training steps of each method."""
    seed: int = 0
    """Same seed, same machine kind: the same bits."""
    out: MaybeFolder = None
    """Folder to make; by default runs/demo-SCENE, with a number at its end if that exists."""
    resume: MaybeFolder = None
    """Go on with the demo in this folder."""
    threads: int = 0
    """Threads of the kernels; 0 takes every core."""
    quiet: bool = False
    """No progress line."""


def main(arguments: list[str]) -> int:
    """Train what is left to train, then show; returns the exit code."""
    asked = parse(DemoArguments, "demo", arguments)
    check_threads(asked.threads)
    check_length(asked.steps)
    with stages(asked.quiet) as line:
        line(f"reading {asked.resume or asked.scene}")
        from ringlight.runs.demo import METHODS_SHOWN

        use_threads(asked.threads)
        demo = _demo(asked)
    options = RunOptions(quiet=asked.quiet)
    for method in METHODS_SHOWN:
        with stages(asked.quiet):
            session = demo.session(method, telling_of_scenes(asked.quiet))
        if session is None:
            continue
        train_and_measure(session, options, command("demo", "--resume", demo.folder))
        if not asked.quiet:
            sys.stderr.write("\n")
    _show(demo, asked.quiet)
    return 0


def _demo(asked: DemoArguments) -> "Demo":
    from ringlight.data.bundled import bundled_scene
    from ringlight.runs.demo import Demo
    from ringlight.runs.folder import make_free_folder

    if asked.resume is not None:
        _refuse_settings(asked)
        return Demo.open(asked.resume)
    bundled_scene(asked.scene)  # before there is a folder of that name
    out = asked.out or make_free_folder(Path("runs") / f"demo-{asked.scene}")
    return Demo.create(out, asked.scene, asked.steps, asked.seed)


def _refuse_settings(asked: DemoArguments) -> None:
    """Raise RecipeError for what a demo that goes on has already."""
    usual = DemoArguments()
    for name in ("scene", "steps", "seed", "out"):
        if getattr(asked, name) != getattr(usual, name):
            given = name.upper() if name == "scene" else f"--{name}"
            raise RecipeError(f"--resume goes on with the demo as it was begun; leave {given} out")


def _show(demo: "Demo", quiet: bool) -> None:
    from ringlight.cli.console import Screen
    from ringlight.measure.compare import compare
    from ringlight.pages.report.build import write_report_page
    from ringlight.runs.opened import open_model
    from ringlight.runs.share import share
    from ringlight.runs.sheet import write_sheet

    comparison = compare(demo.runs)
    Screen().print(comparison.table)
    if comparison.sheet is not None:
        write_sheet(comparison.sheet, demo.sheet)
        sys.stdout.write(f"side by side: {demo.sheet}\n")
    if not quiet:
        sys.stderr.write(_next_steps(demo.runs[-1]))
    with stages(quiet):
        report = write_report_page(demo.runs, demo.report)
        shared = share(open_model(demo.runs[-1]), demo.shared)
    # Last, so that they stand where one looks.
    sys.stdout.write(f"open in a browser: {report.file}, both runs beside each other\n")
    sys.stdout.write(f"open in a browser: {shared.file}, the model of {demo.runs[-1].name} itself\n")


def _next_steps(run: Path) -> str:
    return "\n".join(
        [
            "",
            "what next:",
            f"  fly around it             {command('render', run, '--path', 'orbit')}",
            f"  open it in other viewers  {command('export', run, 'scene.ply')}",
            "  your own photographs      ringlight train my-photos ringlight",
            "      my-photos holds images/ and sparse/0/ (COLMAP), or transforms.json (nerfstudio)",
            "",
        ]
    )
