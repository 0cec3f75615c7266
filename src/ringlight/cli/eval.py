"""``ringlight eval MODEL [SCENE]``: measure a model on held-out photographs."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Annotated, get_args

import tyro

from ringlight.cli.arguments import Device, MaybeFolder, ModelPath, Net, SceneFolder
from ringlight.cli.flags import behind_values
from ringlight.cli.gpu_build import tell_of_build
from ringlight.cli.loading import tell_warnings
from ringlight.cli.parse import parse
from ringlight.cli.stages import StageLine, stages
from ringlight.cli.threads import check_threads, use_threads
from ringlight.core.command_line import command
from ringlight.data.options import ReadingOptions, SceneOptions
from ringlight.errors import RunError

if TYPE_CHECKING:
    from ringlight.measure.report import Report
    from ringlight.runs.folder import RunFolder


@dataclass(frozen=True)
class EvalArguments:
    """Measure a model on held-out photographs: PSNR, SSIM, LPIPS, frames a second, bytes.

    A run folder is measured on its own test views. Its report.json and images/ are written again, with the numbers that
    train gave, and by every network of LPIPS that was used before. With SCENE, or for a model file alone, nothing is
    written unless --out or --images asks for it.
    """

    model: ModelPath
    """Run folder or model file."""
    scene: SceneFolder = None
    """Folder of photographs, or toaster or carpaint, which are bundled; by default the model's own."""
    options: Annotated[ReadingOptions, tyro.conf.arg(name="")] = field(default_factory=ReadingOptions)
    out: MaybeFolder = None
    """New folder for report.json and, without --images, images/. 'ringlight compare' reads it like a run."""
    images: MaybeFolder = None
    """New folder for the pictures alone: test/ as rendered, truth/ as photographed."""
    lpips: tuple[Net, ...] = ("alex",)
    """Networks of LPIPS; the flag without a name measures none. 'ringlight fetch-lpips' gets their weights."""
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
    asked = parse(EvalArguments, "eval", behind_values(arguments, "--lpips", get_args(Net)))
    check_threads(asked.threads)
    with stages(asked.quiet) as line:
        line(f"reading {asked.model}")
        from ringlight.runs.opened import find_model

        use_threads(asked.threads)
        tell_of_build(asked.device)
        run = find_model(asked.model)[1] if asked.scene is None and asked.out is None else None
        with _locked_or_told(run) as held:  # before the model is read: its report is of the same step
            _measure_and_keep(asked, held, line)
    return 0


@contextmanager
def _locked_or_told(run: "RunFolder | None") -> "Iterator[RunFolder | None]":
    """The run, locked inside the block; None where another process works on it, which is said: it writes the report."""
    from ringlight.runs.lock import RunLock, holder

    try:
        lock = None if run is None else RunLock(run.path)
    except RunError:
        assert run is not None
        busy = f"{holder(run.path)} is training or measuring this run"
        sys.stderr.write(f"warning: {run.path}: {busy}; nothing is written, give --out NEW to keep these numbers\n")
        lock = run = None
    try:
        yield run
    finally:
        if lock is not None:
            lock.release()


def _measure_and_keep(asked: EvalArguments, run: "RunFolder | None", line: StageLine) -> None:
    """Measure and show; write the report and pictures of ``run``, or of the folders that were asked for."""
    from ringlight.runs.finish import measure, refuse_older, write_report
    from ringlight.runs.folder import RunFolder, empty_folder
    from ringlight.runs.kept_pictures import KeptPictures
    from ringlight.runs.opened import open_model, scene_of
    from ringlight.runs.training_facts import known_facts, measured_nets

    opened = open_model(asked.model, asked.device)
    scene = scene_of(opened, asked.scene, SceneOptions(**vars(asked.options)), command("eval", asked.model, "FOLDER"))
    tell_warnings(scene)
    trained = opened.stored.header.scene.name
    if asked.scene is not None and trained not in ("", scene.name):
        other = f"the model learned {trained}, these photographs are of {scene.name}"
        sys.stderr.write(f"warning: {other}: figures mean something if both show one scene in one world\n")
    facts, cameras = known_facts(opened), opened.stored.cameras
    kept = run if asked.out is None else RunFolder(empty_folder(asked.out))
    nets = asked.lpips
    if run is not None:
        refuse_older(run, facts.iterations)
        nets = (*nets, *(net for net in measured_nets(run) if nets and net not in nets))
    folders = []
    if asked.images is not None:
        chosen = empty_folder(asked.images)
        folders.append((chosen / "test", chosen / "truth"))
    if kept is not None and (kept is run or asked.images is None):  # a run's pictures are those of its numbers
        folders.append(kept.pictures)
    pictures = KeptPictures(folders) if folders else None
    tell = partial(line, "measuring views")
    report = measure(opened.stored.model, scene, facts, pictures, nets, tell, cameras)
    line.wiped()
    _show(report, asked.json)  # before anything is written that may not be
    if pictures is not None:
        pictures.refuse_failure()
    if kept is not None:
        refuse_older(kept, report.iterations)
        write_report(kept.report, report)
        if not asked.quiet:
            sys.stderr.write(f"written to {kept.path}\n")


def _show(report: "Report", as_json: bool) -> None:
    from ringlight.cli.console import Screen
    from ringlight.measure.json_record import to_json
    from ringlight.measure.table import ResultsTable

    if as_json:
        sys.stdout.write(to_json(report))
    else:
        Screen().print(ResultsTable([(report.preset, report)]))
    sys.stdout.flush()
