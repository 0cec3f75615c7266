"""Speed of a whole training step, and of its stages: what Python and torch add to the kernels."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import torch

from ringlight.bench.kernels_alone import AdamKernel, LossKernel, RasterKernel, gradients_like
from ringlight.bench.raster import NATIVE
from ringlight.bench.record import Circumstances
from ringlight.bench.staged_step import StagedStep
from ringlight.bench.timing import SHORTEST_MS, TOTAL, Budget, Contestant, Timing, interleaved
from ringlight.bench.workload import Size, workload, workload_scene
from ringlight.core.gaussians import GEOMETRY
from ringlight.core.rendering import OPACITY_FACTOR
from ringlight.data.load import load_scene
from ringlight.data.options import SceneOptions
from ringlight.errors import RecipeError
from ringlight.fit.train import Training, train
from ringlight.models.parts import joined
from ringlight.models.splats import COLUMNS_PREFIX
from ringlight.rasterize.contract import Rasterizer

SCHEDULED_STEP = 7_501
"""The workload's step: densification counts pulls, as in half of a run, but edits no rows at this one."""

WHOLE, STAGED, KERNELS = "whole", "staged", "kernels"


@dataclass(frozen=True)
class StepBench:
    """What ``ringlight bench step`` measured.

    ``whole`` is the step of the training loop; ``stages`` are the same work cut at its seams, each timed alone, whose
    sum is ``staged``. ``kernels`` are the floor: the compiled rasterizer, loss and Adam on the same inputs, called
    alone. The floor ratios are whole over their sum; without the CPU's rasterizer there is no such floor.
    """

    circumstances: Circumstances
    method: str
    scene: str
    rasterizer: str
    gaussians: int
    image: str
    whole: Timing
    staged: Timing
    stages: dict[str, Timing]
    kernels: dict[str, Timing]
    wall_floor_ratio: float | None
    cpu_floor_ratio: float | None


@dataclass(frozen=True)
class Subject:
    """A training at some point of its run; ``step`` is the one that gets repeated."""

    method: str
    scene: str
    training: Training
    step: int


def subject_of_workload(method: str, recipe: Any, size: Size, rasterize: Rasterizer, seed: int = 0) -> Subject:
    """The method on the standard workload, with every schedule at its end: all harmonics, the light field on."""
    if size.channels != 3:
        raise RecipeError(f"a training step draws 3 channels, not {size.channels}; leave --channels away")
    work = workload(size, seed)
    scene = workload_scene(work, seed)
    training = recipe.build(scene, rasterize, seed)
    training.model.load_columns({name: getattr(work.gaussians, name) for name in GEOMETRY})
    # A model made for rendering has everything switched on; only a build for training starts with less.
    finished = recipe.model(training.model.gaussians, scene.box, rasterize)
    shown = finished.state_dict()
    for name, buffer in training.model.named_buffers():
        if name in shown:
            buffer.copy_(shown[name])
    training.step = min(SCHEDULED_STEP, recipe.steps) - 1
    return Subject(method, f"workload {size.name}", training, training.step + 1)


def subject_of_scene(method: str, recipe: Any, path: Path, after: int, rasterize: Rasterizer, seed: int = 0) -> Subject:
    """The method on photographs, once ``after`` steps of training have been done. Raises SceneError, RecipeError."""
    if not 0 <= after < recipe.steps:
        raise RecipeError(f"--after is {after}; the run has {recipe.steps} steps: give less")
    scene = load_scene(path, SceneOptions())
    training = recipe.build(scene, rasterize, seed)
    for _ in islice(train(training), after):
        pass
    return Subject(method, f"{scene.name} after {after} steps", training, training.step + 1)


def bench_step(subject: Subject, budget: Budget, now: Circumstances) -> StepBench:
    """Repeat one step, whole and cut into stages in turns; everything is put back before each round, off the clock."""
    training = subject.training
    put_back = _snapshot(training)
    staged = StagedStep(training, subject.step)
    contestants = {
        WHOLE: Contestant({WHOLE: lambda: next(train(training))}, put_back),
        STAGED: Contestant(staged.stages(), put_back),
    }
    if training.model.rasterize.name == NATIVE:
        # Put back as well, though nothing has changed: caches are then as cold for all three.
        contestants[KERNELS] = Contestant(_kernels_alone(subject), put_back)
    timings = interleaved(contestants, budget)
    whole, stages = timings[WHOLE][WHOLE], timings[STAGED]
    total = stages.pop(TOTAL)
    kernels = timings.get(KERNELS, {})
    floor = kernels.get(TOTAL)
    camera = training.batches.at(subject.step).camera
    return StepBench(
        circumstances=now,
        method=subject.method,
        scene=subject.scene,
        rasterizer=training.model.rasterize.name,
        gaussians=len(training.model),
        image=f"{camera.width}x{camera.height}",
        whole=whole,
        staged=total,
        stages=stages,
        kernels=kernels,
        wall_floor_ratio=whole.wall_ms / max(floor.wall_ms, SHORTEST_MS) if floor else None,
        cpu_floor_ratio=whole.cpu_ms / max(floor.cpu_ms, SHORTEST_MS) if floor else None,
    )


def _kernels_alone(subject: Subject) -> dict[str, Callable[[], object]]:
    """The step's kernels on the step's inputs; Adam updates every parameter of the model."""
    training = subject.training
    batch = training.batches.at(subject.step)
    target = training.targets.of(batch, training.batches.scene.background != "random")
    model, table = training.model, training.model.gaussians
    with torch.no_grad():
        channels = dict(model.color.channels(table, batch.camera))
    factor = channels.pop(OPACITY_FACTOR, None)
    blended = joined(list(channels.values()))
    behind = torch.nn.functional.pad(batch.background, (0, blended.shape[1] - len(batch.background)))
    raster = RasterKernel(table, blended, batch.camera, behind, model.options, None if factor is None else factor[:, 0])
    # For channels that the loss does not see any number will do: what a gradient costs does not depend on it.
    by_image = torch.ones_like(raster.image)
    loss = LossKernel(raster.image[:3], target, training.loss, by_image[:3])
    parameters = dict(model.named_parameters())
    known = {COLUMNS_PREFIX + name: gradient for name, gradient in raster.gradients.items()}
    groups = [training.optimizer.groups[name] for name in parameters]
    adam = AdamKernel(list(parameters.values()), gradients_like(parameters, known), groups)
    return {
        "raster forward": raster.forward,
        "loss": loss.run,
        "raster backward": lambda: raster.backward(by_image),
        "adam": adam.run,
    }


def _snapshot(training: Training) -> Callable[[], None]:
    """What puts the training back to where it is now: parameters, moments, counters, and the step."""
    kept = {name: tensor.detach().clone() for name, tensor in training.state().items()}
    return lambda: training.restore(kept)
