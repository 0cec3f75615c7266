"""From a trained model to its numbers: renders the held-out views, measures, keeps report.json and images/."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

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
from ringlight.errors import OutputError, RunError, SceneError
from ringlight.files.atomic import write_text
from ringlight.fit.guard import sentences
from ringlight.measure.evaluate import Scores, evaluate, mean_psnr, scores_without_views
from ringlight.measure.json_record import to_json
from ringlight.measure.lpips import Net
from ringlight.measure.machine import machine
from ringlight.measure.nearness import distances, means_of_thirds
from ringlight.measure.report import Report, read_report
from ringlight.measure.speed import FrameRate, frames_per_second
from ringlight.methods.table import method_of
from ringlight.models.contract import Model
from ringlight.models.feature_shares import feature_shares
from ringlight.runs.changed_settings import settings_by_name
from ringlight.runs.folder import RunFolder
from ringlight.runs.kept_pictures import KeptPictures
from ringlight.runs.session import Session
from ringlight.runs.training_facts import TrainingFacts

Tell = Callable[[int, int], None]

MOST_SEEN = 20
"""Training views that are measured where there are no test views."""


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
        test_views_trained_on=_trained_on(scene.test, cameras),
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


def _trained_on(views: Sequence[View], trained: Sequence[Camera]) -> int:
    """How many of the views have a pose that the model was trained with: as measures of new views they say nothing.
    Cameras on a tripod share a place and look elsewhere."""
    known = {tuple(camera.world_to_camera.flatten().tolist()) for camera in trained}
    return sum(tuple(view.camera.world_to_camera.flatten().tolist()) in known for view in views)


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
        settings=settings_by_name(session.record),
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
    pictures = KeptPictures([session.folder.pictures])
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
