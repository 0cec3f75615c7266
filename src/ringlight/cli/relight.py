"""``ringlight relight MODEL PHOTOS OUT``: learn the light of other photographs for a model."""

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from ringlight.cli.arguments import Device, ModelPath
from ringlight.cli.flags import flags_in
from ringlight.cli.ineffective import watching_without_effect
from ringlight.cli.loading import telling_of_scenes
from ringlight.cli.parse import parse, refuse
from ringlight.cli.run_length import check_length
from ringlight.cli.run_training import RunOptions, check_steps, check_watching, train_and_measure
from ringlight.cli.stages import stages
from ringlight.cli.threads import check_threads, use_threads
from ringlight.cli.unbegun import stopped_unbegun
from ringlight.core.command_line import command
from ringlight.data.bundled import scene_folder

if TYPE_CHECKING:
    from ringlight.measure.report import Report
    from ringlight.runs.relight import PackReport
    from ringlight.runs.session import Session


@dataclass(frozen=True)
class RelightArguments:
    """Learn the light of other photographs for a model: same subject, same cameras, another sun.

    Geometry, opacities and base colours stay; what is learned is what all Gaussians share: networks, maps, rings, the
    shared basis. Writes a run folder like 'ringlight train', with the relit model, and in it light.safetensors, a pack
    of a few tens of kilobytes that 'ringlight edit MODEL OUT --light' and 'ringlight share MODEL OUT --light' take.
    Ctrl-C finishes the step and saves; 'ringlight relight --resume OUT' goes on from there.
    """

    model: ModelPath
    """Run folder or model file."""
    photos: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="PHOTOS")]
    """Folder of photographs with cameras, in the model's own world, or toaster or carpaint."""
    out: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="OUT")]
    """Run folder to make."""
    steps: int = 300
    """Training steps, one photograph each."""
    seed: int = 0
    """Same seed, same machine kind: the same bits."""
    device: Device = "auto"
    """Rasterizer. auto is the fastest of this machine; reference is plain torch, and slow."""
    running: Annotated[RunOptions, tyro.conf.arg(name="")] = field(default_factory=RunOptions)
    resume: Annotated[Path | None, tyro.conf.arg(metavar="OUT")] = None
    """Go on with this run, in place of MODEL, PHOTOS and OUT. One that is complete writes its pack again."""


@dataclass(frozen=True)
class ResumeArguments:
    """Go on with a run that relights a model, with the same bits as if it had never stopped."""

    resume: Annotated[Path, tyro.conf.arg(metavar="OUT")]
    """Run folder."""
    running: Annotated[RunOptions, tyro.conf.arg(name="")] = field(default_factory=RunOptions)


@dataclass(frozen=True)
class Relit:
    """What ``--json`` prints."""

    report: "Report"
    pack: "PackReport"


def main(arguments: list[str]) -> int:
    """Relight, measure, write the pack; returns the exit code."""
    return _resume(arguments) if "--resume" in flags_in(arguments) else _start(arguments)


def _start(arguments: list[str]) -> int:
    asked = parse(RelightArguments, "relight", arguments)
    check_length(asked.steps)
    check_steps(asked.running, asked.steps)
    check_threads(asked.running.threads)
    photographs = scene_folder(asked.photos)
    with stages(asked.running.quiet) as line:
        line(f"reading {asked.model}")
        from ringlight.runs.opened import open_model
        from ringlight.runs.relight import start_relighting

        check_watching(asked.running)
        use_threads(asked.running.threads)
        loaded = telling_of_scenes(asked.running.quiet)
        opened = open_model(asked.model)
        try:
            session = start_relighting(opened, photographs, asked.out, asked.steps, asked.seed, asked.device, loaded)
        except KeyboardInterrupt as interruption:
            line.wiped()
            raise stopped_unbegun(interruption, "relight", asked.out, True, "another OUT") from None
    return _train(session, asked.running)


def _resume(arguments: list[str]) -> int:
    if arguments and not arguments[0].startswith("-"):
        refuse("relight", "--resume stands in place of MODEL, PHOTOS and OUT; write: ringlight relight --resume OUT")
    wish = parse(ResumeArguments, "relight", arguments)
    check_threads(wish.running.threads)
    with stages(wish.running.quiet) as line:
        line(f"reading {wish.resume}")
        from ringlight.runs.finish import complete_report
        from ringlight.runs.folder import RunFolder
        from ringlight.runs.record import RunRecord
        from ringlight.runs.relight import refuse_other_runs
        from ringlight.runs.resume import resume_run

        use_threads(wish.running.threads)
        record = RunRecord.read(RunFolder.open(wish.resume).path)
        refuse_other_runs(wish.resume, record)
        check_steps(wish.running, record.steps)
        check_watching(wish.running)
        session = resume_run(wish.resume, loaded=telling_of_scenes(wish.running.quiet))
        report = complete_report(session)
    if report is None:
        return _train(session, wish.running)
    for sentence in watching_without_effect(wish.running):
        sys.stderr.write(f"warning: {sentence}\n")
    return _finish(session, report, wish.running)


def _train(session: "Session", options: RunOptions) -> int:
    report = train_and_measure(session, options, command("relight", "--resume", session.folder.path))
    return _finish(session, report, options)


def _finish(session: "Session", report: "Report", options: RunOptions) -> int:
    from ringlight.cli.console import Screen
    from ringlight.measure.json_record import to_json
    from ringlight.measure.table import ResultsTable
    from ringlight.runs.relight import finish_relighting

    with stages(options.quiet):
        pack = finish_relighting(session.folder)
    if options.json:
        sys.stdout.write(to_json(Relit(report, pack)))
        return 0
    Screen().print(ResultsTable([(report.preset, report)]))
    near = "" if pack.picture_psnr is None else f"; its pictures against the run's own: {pack.picture_psnr:.1f} dB PSNR"
    sys.stdout.write(f"{pack.file}: light pack, {pack.bytes_file / 1000:.1f} kB{near}\n")
    if not options.quiet:
        start = session.record.start or "MODEL"
        see = command("share", start, "page.html", "--light", pack.file)
        sys.stderr.write(f"written to {session.folder.path}; blend both lights in a page with: {see}\n")
    return 0
