"""``ringlight train SCENE METHOD``: learn a scene from a folder of posed photographs."""

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from ringlight.cli.arguments import Device, MaybeFolder
from ringlight.cli.flags import flags_in, flags_of
from ringlight.cli.gpu_build import tell_of_build
from ringlight.cli.ineffective import idle_settings, start_without_effect, watching_without_effect
from ringlight.cli.loading import telling_of_scenes
from ringlight.cli.methods import Method, preset_of
from ringlight.cli.parse import parse, refuse
from ringlight.cli.poses import scene_with_cameras
from ringlight.cli.run_length import check_length
from ringlight.cli.run_training import RunOptions, check_steps, check_watching, train_and_measure
from ringlight.cli.stages import stages
from ringlight.cli.threads import check_threads, use_threads
from ringlight.cli.train_flags import method_among, refuse_flags_of_other_methods, refuse_unknown_and_misplaced_flags
from ringlight.cli.unbegun import stopped_unbegun
from ringlight.cli.verifying import verify_run
from ringlight.core.command_line import command
from ringlight.data.bundled import scene_folder
from ringlight.data.options import SceneOptions
from ringlight.errors import RecipeError, RunError
from ringlight.methods.recipe import Recipe
from ringlight.methods.table import METHODS

if TYPE_CHECKING:
    from ringlight.measure.report import Report
    from ringlight.runs.session import Session

OneFlagEach = tyro.conf.FlagCreatePairsOff


@dataclass(frozen=True)
class TrainArguments:
    """Learn a scene from posed photographs, in --steps N steps.

    Writes a run folder: model.safetensors, report.json, recipe.json, checkpoints and images/. Ctrl-C finishes the
    step and saves; 'ringlight train --resume RUN' goes on from there. --steps and all settings of a method are
    explained by 'ringlight train SCENE METHOD --help'.
    """

    scene: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="SCENE")]
    """Folder of photographs with cameras: COLMAP, Blender/NeRF-Synthetic or nerfstudio layout. toaster and carpaint are
    bundled, where no folder is called so."""
    method: Method
    options: Annotated[SceneOptions, tyro.conf.arg(name=""), OneFlagEach] = field(default_factory=SceneOptions)
    poses: Literal["given", "auto"] = "given"
    """auto: where SCENE has no cameras they are found first, as by 'ringlight poses SCENE'."""
    running: Annotated[RunOptions, tyro.conf.arg(name=""), OneFlagEach] = field(default_factory=RunOptions)
    out: MaybeFolder = None
    """Run folder to make; by default runs/SCENE-METHOD, or runs/SCENE-METHOD-2, ... where that exists."""
    seed: int = 0
    """Same seed, same machine kind: the same bits."""
    device: Device = "auto"
    """Rasterizer. auto is the fastest of this machine; reference is plain torch, and slow."""
    from_: Annotated[Path | None, tyro.conf.arg(name="from", metavar="MODEL|PLY")] = None
    """Start from this run, model file or PLY of 3D Gaussians, in the scene's own world. A model of the same method is
    taken whole, of another its Gaussians with their base colours. No steps are coarse then."""
    resume: Annotated[Path | None, tyro.conf.arg(metavar="RUN")] = None
    """Go on with this run, in place of SCENE and METHOD. It keeps its recipe, scene and seed. With --steps it has so
    many steps more, also where it was finished."""
    verify: int | None = None
    """Do this many steps four times, in other circumstances each time, and compare all bits. Nothing is written."""


@dataclass(frozen=True)
class ResumeArguments:
    """Go on with a run that was stopped, with the same bits as if it had never stopped."""

    resume: Annotated[Path, tyro.conf.arg(metavar="RUN")]
    """Run folder."""
    steps: int = 0
    """Steps to add behind the run's last: rates run their course once more, density control stays over."""
    running: Annotated[RunOptions, tyro.conf.arg(name="")] = field(default_factory=RunOptions)


GLOSSARY = (
    "PSNR and SSIM: likeness to photographs that training did not see, more is better (PSNR in dB: one more shows). "
    "LPIPS: difference to the eye, less is better. raw MB: what showing the scene takes. core s: processor "
    "seconds, with those before the first step.\n"
)
"""Below the table of a run, for who reads one for the first time."""

RESUMED = {"--resume", "--steps"} | flags_of(RunOptions)
OF_ANY_METHOD = flags_of(TrainArguments) | flags_of(RunOptions) | flags_of(SceneOptions) | {"--help"}


def main(arguments: list[str]) -> int:
    """Train, then measure; returns the exit code."""
    refuse_unknown_and_misplaced_flags(arguments, OF_ANY_METHOD)
    refuse_flags_of_other_methods(arguments, OF_ANY_METHOD)
    return _resume(arguments) if "--resume" in flags_in(arguments) else _start(arguments)


def _start(arguments: list[str]) -> int:
    method = method_among(arguments[: arguments.index("--help")] if "--help" in arguments else arguments)
    asked = parse(TrainArguments, "train", arguments, in_pairs=True, before="SCENE" if method else "", of=method or "")
    preset = preset_of(arguments, asked.method)
    recipe: Recipe = asked.method
    check_length(recipe.steps)
    check_steps(asked.running, recipe.steps)
    check_threads(asked.running.threads)
    scene = scene_folder(asked.scene)
    _warn_of(idle_settings(recipe, METHODS[preset]))
    with stages(asked.running.quiet) as line:
        line(f"reading {scene}")  # before torch is loaded, which takes seconds
        from ringlight.runs.start import start_run

        check_watching(asked.running)
        use_threads(asked.running.threads)
        tell_of_build(asked.device)
        if asked.poses == "auto":
            line.wiped()
            scene = scene_with_cameras(scene, asked.running)
        if asked.verify is not None:
            if asked.from_ is not None:
                raise RecipeError("--verify begins at the scene's points; leave out --from")
            return verify_run(scene, asked.options, recipe, asked.seed, asked.device, asked.verify, asked.running.json)
        out = asked.out or Path("runs") / f"{scene.resolve().name}-{preset}"
        loaded = telling_of_scenes(asked.running.quiet)
        try:
            session = start_run(
                out, scene, preset, recipe, asked.options, asked.seed, asked.device, asked.from_, loaded,
                numbered=asked.out is None,
            )  # fmt: skip
        except KeyboardInterrupt as interruption:
            line.wiped()
            raise stopped_unbegun(interruption, "train", asked.out, asked.from_ is not None, "--out NEW") from None
    _warn_of(start_without_effect(asked.options, recipe, session))
    return _train(session, asked.running)


def _warn_of(sentences: list[str]) -> None:
    for sentence in sentences:
        sys.stderr.write(f"warning: {sentence}\n")


def _resume(arguments: list[str]) -> int:
    for flag in flags_in(arguments):
        if flag not in RESUMED and flag != "--help":
            remedy = "leave it out, or start a new run"
            refuse("train", f"a resumed run keeps its recipe, scene and seed, so {flag} cannot change it; {remedy}")
    if arguments and not arguments[0].startswith("-"):
        refuse("train", "--resume stands in place of SCENE and METHOD; write: ringlight train --resume RUN")
    wish = parse(ResumeArguments, "train", arguments)
    check_threads(wish.running.threads)
    with stages(wish.running.quiet) as line:
        line(f"reading {wish.resume}")
        from ringlight.runs.finish import complete_report
        from ringlight.runs.folder import RunFolder
        from ringlight.runs.going_on import resuming
        from ringlight.runs.record import RunRecord
        from ringlight.runs.relight import relights
        from ringlight.runs.resume import resume_run

        use_threads(wish.running.threads)
        if "--steps" in flags_in(arguments) and wish.steps < 1:
            raise RecipeError(f"--steps is {wish.steps}; give at least 1 step to add")
        record = RunRecord.read(RunFolder.open(wish.resume).path)
        if relights(record):
            again = resuming(wish.resume, record)
            raise RunError(f"{wish.resume}: learns a light, of which a pack is made; go on with: {again}")
        # Before its record has the added steps: who corrects a flag and asks again would add them twice.
        check_steps(wish.running, record.steps + wish.steps)
        check_watching(wish.running)
        session = resume_run(wish.resume, wish.steps, telling_of_scenes(wish.running.quiet))
        report = complete_report(session)
    if report is None:
        return _train(session, wish.running)
    _warn_of(watching_without_effect(wish.running))
    if not wish.running.quiet:
        sys.stderr.write(
            f"{wish.resume}: is complete after step {record.steps} and was measured; add steps by: "
            f"{command('train', '--resume', wish.resume)} --steps MORE, or measure it again with: "
            f"{command('eval', wish.resume)}\n"
        )
    _print(report, wish.running)
    return 0


def _train(session: "Session", options: RunOptions) -> int:
    run = session.folder.path
    report = train_and_measure(session, options, command("train", "--resume", run))
    _print(report, options)
    if not options.json:
        if not options.quiet:
            sys.stderr.write(GLOSSARY)
        path = () if session.scene.test else ("--path", "orbit")
        sys.stderr.write(f"written to {run}; see it with: {command('render', run, *path)}\n")
    return 0


def _print(report: "Report", options: RunOptions) -> None:
    from ringlight.cli.console import Screen
    from ringlight.measure.json_record import to_json
    from ringlight.measure.table import ResultsTable

    if options.json:
        sys.stdout.write(to_json(report))
    else:
        Screen().print(ResultsTable([(report.preset, report)]))
