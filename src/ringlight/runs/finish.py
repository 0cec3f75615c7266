"""From a trained model to its numbers: renders the held-out views, measures, keeps report.json and images/."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from jaxtyping import Float
from torch import Tensor

import ringlight
from ringlight.core import stages
from ringlight.core.camera import Camera
from ringlight.core.raw_bytes import bytes_by_part
from ringlight.core.rendering import Rendering
from ringlight.core.scene import Scene, View
from ringlight.core.want import Want
from ringlight.core.words import counted
from ringlight.errors import ModelFileError, OutputError, RunError, SceneError
from ringlight.files.atomic import write_text
from ringlight.files.tensor_file import read_metadata
from ringlight.fit.guard import sentences
from ringlight.measure.evaluate import Scores, evaluate, mean_psnr, scores_without_views
from ringlight.measure.json_record import to_json
from ringlight.measure.lpips import Net
from ringlight.measure.machine import machine, source_commit
from ringlight.measure.nearness import distances, means_of_thirds
from ringlight.measure.report import CurvePoint, Report, read_report
from ringlight.measure.speed import FrameRate, frames_per_second
from ringlight.methods.table import method_of
from ringlight.models.contract import Model
from ringlight.models.feature_shares import feature_shares
from ringlight.runs.folder import RunFolder
from ringlight.runs.kept_pictures import KeptPictures
from ringlight.runs.opened import Opened
from ringlight.runs.record import RunRecord
from ringlight.runs.session import Session

Tell = Callable[[int, int], None]

SECONDS = {
    "train_seconds": "wall_seconds",
    "train_cpu_seconds": "cpu_seconds",
    "saving_seconds": "saving_seconds",
    "choosing_cpu_seconds": "choosing_seconds",
}
"""What reports call a checkpoint's clocks."""


MOST_SEEN = 20
"""Training views that are measured where there are no test views."""


@dataclass(frozen=True)
class TrainingFacts:
    """What the pictures do not tell, field by field as in a ``Report``; None where it is not known, as for a model that
    was trained elsewhere."""

    preset: str
    method: str
    seed: int | None = None
    iterations: int | None = None
    planned: int | None = None
    train_seconds: float | None = None
    train_cpu_seconds: float | None = None
    saving_seconds: float | None = None
    choosing_cpu_seconds: float | None = None
    peak_bytes: int | None = None
    training_bytes: dict[str, int] = field(default_factory=dict)
    collapses: tuple[str, ...] = ()
    bytes_file: int | None = None
    curve: tuple[CurvePoint, ...] = ()
    commit: str | None = field(default_factory=source_commit)
    """Of the code that trained, or else measures."""


def measure(
    model: Model,
    scene: Scene,
    facts: TrainingFacts,
    pictures: KeptPictures | None = None,
    nets: tuple[Net, ...] = ("alex",),
    tell: Tell | None = None,
    trained: Sequence[Camera] | None = None,
) -> Report:
    """Measure on the test views; ``pictures``, if given, keep the rendered views and the photographs, or a failure.

    ``trained`` are the cameras that the model was trained with, if other than those of the scene's training views.
    ``tell`` hears (views done, views in all), training views among them. Of a scene without test views training views
    alone are measured. Raises SceneError where a photograph of the test views cannot be read.
    """
    background = scene.background_color

    render = _shows(model, background)
    cameras = [view.camera for view in scene.train] if trained is None else trained
    seen, tested = _training_views(scene, cameras), len(scene.test)

    def telling(before: int) -> Tell | None:
        return None if tell is None else lambda done, _: tell(before + done, tested + len(seen))

    if scene.test:
        scores = evaluate(render, scene.test, background, lpips_nets=nets, keep_images=pictures, progress=telling(0))
    else:
        scores = scores_without_views(scene.train)
    known = None
    with suppress(SceneError):  # where a photograph is gone, test views are measured all the same
        known = mean_psnr(render, seen, background, telling(tested)) if seen else None
    stages.tell("timing pictures")
    speed = frames_per_second(render, [view.camera for view in scene.test or seen or scene.train[:MOST_SEEN]])
    report = _report(scene, facts, scores, model, speed)
    shares = feature_shares(model, cameras, background)
    return replace(
        report,
        psnr_train=known,
        psnr_thirds=_psnr_thirds(scores, scene, cameras),
        saturated_features=shares.saturated if shares else None,
        constant_features=shares.constant if shares else None,
        hidden_units_off=shares.off if shares else None,
    )


def psnr_of_views(model: Model, scene: Scene, tell: Tell | None = None) -> float:
    """Mean PSNR over the test views, dB, of the model as it is now."""
    background = scene.background_color
    return mean_psnr(_shows(model, background), scene.test, background, tell)


def _training_views(scene: Scene, trained: Sequence[Camera]) -> list[View]:
    """Views of the scene's training split that the model was trained with: as many as test views, evenly spread, or up
    to MOST_SEEN without test views."""
    apart = distances([view.camera for view in scene.train], trained)
    seen = [view for view, distance in zip(scene.train, apart, strict=True) if distance == 0]
    count = min(len(seen), len(scene.test) or MOST_SEEN)
    return [seen[index * len(seen) // count] for index in range(count)]


def _psnr_thirds(scores: Scores, scene: Scene, trained: Sequence[Camera]) -> tuple[float, ...] | None:
    apart = distances([view.camera for view in scene.test], trained)
    return means_of_thirds([image.psnr for image in scores.images], apart) if trained else None


def _shows(model: Model, background: Float[Tensor, "3"]) -> Callable[[Camera], Rendering]:
    return lambda camera: model.render(camera, background, Want.PICTURE)


def measure_session(session: Session, nets: tuple[Net, ...] = ("alex",), tell: Tell | None = None) -> Report:
    """End a training run: measure it, write its report, and put its numbers into the model file too."""
    facts = TrainingFacts(
        preset=session.record.preset,
        method=method_of(session.record.recipe),
        seed=session.record.seed,
        iterations=session.training.step,
        planned=session.training.steps,
        train_seconds=session.clock.wall,
        train_cpu_seconds=session.clock.cpu,
        saving_seconds=session.clock.saving,
        choosing_cpu_seconds=session.clock.choosing,
        peak_bytes=session.memory.growth(),
        training_bytes=session.training.bytes_by_part(),
        collapses=sentences(session.training.guard.collapses) if session.training.guard else (),
        curve=tuple(session.history.points),
        commit=session.commit,
    )
    pictures = KeptPictures(*session.folder.pictures)
    report = measure(session.training.model, session.scene, facts, pictures, nets, tell)
    pictures.refuse_failure()
    session.save_model({"psnr": report.psnr, "ssim_same": report.ssim_same, "lpips_alex": report.lpips_alex})
    report = replace(report, bytes_file=session.folder.model.stat().st_size)
    write_report(session.folder.report, report)
    return report


def complete_report(session: Session) -> Report | None:
    """The report of a run that has done all its steps and was measured after the last; None for any other run."""
    if session.training.step < session.training.steps:
        return None
    try:
        report = read_report(session.folder.path)
    except RunError:
        return None
    return report if report.iterations == session.training.step else None


def refuse_older(run: RunFolder, step: int | None) -> None:
    """Raises OutputError where the run's report is of a later step than ``step``, which is measured."""
    kept = None
    with suppress(RunError):  # a damaged report may be replaced
        kept = read_report(run.path).iterations
    if kept is not None and step is not None and kept > step:
        raise OutputError(
            f"{run.report}: is of step {kept}, and the model of step {step}; the report stays as it is, give --out NEW "
            "to measure this model"
        )


def write_report(path: Path, report: Report) -> None:
    """Write report.json, all or nothing. Raises OutputError."""
    write_text(path, to_json(report))


def known_facts(opened: Opened) -> TrainingFacts:
    """What a model's file and its run folder still know of its training; a damaged report or checkpoint is skipped."""
    header, run = opened.stored.header, opened.run
    planned, size = header.recipe.get("steps"), opened.file.stat().st_size
    facts = TrainingFacts(header.preset, header.method, bytes_file=size)
    if header.step:  # a model that was imported was trained elsewhere
        longest = max(planned, header.step) if isinstance(planned, int) else None
        facts = replace(facts, iterations=header.step, planned=longest)
    if run is None:
        return facts
    record = RunRecord.read(run.path)
    return replace(facts, seed=record.seed, planned=record.steps, **_costs(run))


def _costs(run: RunFolder) -> dict[str, Any]:
    """What training took, from the report, else its seconds from the checkpoint."""
    with suppress(RunError):
        report = read_report(run.path)
        kept = (*SECONDS, "peak_bytes", "training_bytes", "collapses", "curve", "commit")
        return {name: getattr(report, name) for name in kept}
    with suppress(ModelFileError, KeyError, ValueError):
        stored = read_metadata(next(iter(run.checkpoints), run.checkpoint))
        return {name: float(stored[kept]) for name, kept in SECONDS.items() if kept in stored}
    return {}


def _report(scene: Scene, facts: TrainingFacts, scores: Scores, model: Model, speed: FrameRate) -> Report:
    (number, noun), _ = model.rendering_size()
    parts = bytes_by_part(model.rendering_tensors())
    done, seconds = facts.iterations, facts.train_seconds
    return Report(
        version=ringlight.__version__,
        dataset=scene.format,
        scene=scene.name,
        split=f"{len(scene.train)} training, {counted(len(scene.test), 'test view')}",
        background=scene.background,
        notes=scene.notes,
        counted=number,
        noun=noun,
        bytes_raw=sum(parts.values()),
        bytes_by_part=parts,
        steps_per_second=done / seconds if done and seconds else None,
        fps=speed.fps,
        fps_note=speed.note,
        machine=machine(),
        **vars(facts),
        **vars(scores),
    )
