"""From a trained model to its numbers: renders the held-out views, measures, writes report.json and images/."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

import ringlight
from ringlight.core.camera import Camera
from ringlight.core.rendering import Rendering
from ringlight.core.scene import Scene, View
from ringlight.errors import SceneError
from ringlight.files.atomic import write_text
from ringlight.files.video import save_image
from ringlight.measure.evaluate import Scores, evaluate
from ringlight.measure.machine import machine, source_commit
from ringlight.measure.picture_names import picture_name
from ringlight.measure.report import Report
from ringlight.measure.size import bytes_by_part
from ringlight.measure.speed import frames_per_second
from ringlight.methods.store import for_rendering
from ringlight.models.splats import SplatModel
from ringlight.runs.folder import RunFolder
from ringlight.runs.session import Session

Tell = Callable[[int, int], None]


@dataclass(frozen=True)
class TrainingFacts:
    """What only the training run knows; all None for a model that was trained elsewhere."""

    preset: str
    method: str
    seed: int | None = None
    steps: int | None = None
    wall_seconds: float | None = None
    cpu_seconds: float | None = None


def measure(
    model: SplatModel,
    scene: Scene,
    facts: TrainingFacts,
    folder: RunFolder,
    nets: tuple[str, ...] = ("alex",),
    tell: Tell | None = None,
) -> Report:
    """Measure on the test views, keep their pictures in the folder, and write the report there.

    Raises SceneError where the scene holds no test views, OutputError where the folder cannot be written.
    """
    if not scene.test:
        raise SceneError(f"{scene.source}: has no test views; give --holdout-every 8, or a test split")
    background = scene.background_color
    folder.renders.mkdir(parents=True, exist_ok=True)
    folder.truths.mkdir(parents=True, exist_ok=True)

    def render(camera: Camera) -> Rendering:
        return model.render(camera, background)

    def keep(view: View, image: Float[Tensor, "H W 3"], truth: Float[Tensor, "H W 3"]) -> None:
        save_image(folder.renders / picture_name(view.name), image)
        save_image(folder.truths / picture_name(view.name), truth)

    scores = evaluate(render, scene.test, background, lpips_nets=nets, keep_images=keep, progress=tell)
    rate = frames_per_second(render, [view.camera for view in scene.test])
    tensors = for_rendering(model)
    report = _report(scene, facts, scores, tensors, folder.model, (rate.fps, rate.note))
    write_text(folder.report, report.to_json())
    return report


def measure_session(session: Session, nets: tuple[str, ...] = ("alex",), tell: Tell | None = None) -> Report:
    """End a training run: measure it, and put its numbers into the model file too."""
    facts = TrainingFacts(
        preset=session.record.preset,
        method=type(session.record.recipe).__name__,
        seed=session.record.seed,
        steps=session.training.step,
        wall_seconds=session.clock.wall,
        cpu_seconds=session.clock.cpu,
    )
    report = measure(session.training.model, session.scene, facts, session.folder, nets, tell)
    session.save_model({"psnr": report.psnr, "ssim_same": report.ssim_same, "lpips_alex": report.lpips_alex})
    return report


def _report(
    scene: Scene,
    facts: TrainingFacts,
    scores: Scores,
    tensors: dict[str, torch.Tensor],
    model_file: Path,
    speed: tuple[float, str],
) -> Report:
    parts = bytes_by_part(tensors)
    rate = facts.steps / facts.wall_seconds if facts.steps and facts.wall_seconds else None
    return Report(
        method=facts.method,
        preset=facts.preset,
        version=ringlight.__version__,
        commit=source_commit(),
        seed=facts.seed,
        dataset=scene.format,
        scene=scene.name,
        split=f"{len(scene.train)} training, {len(scene.test)} test views",
        background=scene.background,
        notes=scene.notes,
        iterations=facts.steps,
        n_gaussians=len(tensors["columns.means"]),
        bytes_raw=sum(parts.values()),
        bytes_by_part=parts,
        bytes_file=model_file.stat().st_size if model_file.exists() else None,
        train_seconds=facts.wall_seconds,
        train_cpu_seconds=facts.cpu_seconds,
        steps_per_second=rate,
        fps=speed[0],
        fps_note=speed[1],
        machine=machine(),
        **vars(scores),
    )
