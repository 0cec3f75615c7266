"""Speed of a whole training step, and of its stages: what Python and torch add to the kernels."""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import cast

import torch

from ringlight.bench.kernels_alone import AdamKernel, LossKernel, RasterKernel, gradients_like
from ringlight.bench.raster import NATIVE
from ringlight.bench.record import Circumstances
from ringlight.bench.stopwatch import Stopwatch
from ringlight.bench.timing import SHORTEST_MS, TOTAL, Budget, Contestant, Timing, interleaved
from ringlight.bench.workload import Size, workload, workload_scene
from ringlight.core.gaussians import GEOMETRY
from ringlight.core.want import Want
from ringlight.data.batches import ImageBatch
from ringlight.data.load import load_scene
from ringlight.data.options import SceneOptions
from ringlight.errors import RecipeError
from ringlight.fit.loss import PhotographLoss
from ringlight.fit.train import Training, train
from ringlight.methods.recipe import Recipe
from ringlight.models.splats import COLUMNS_PREFIX, SplatModel
from ringlight.rasterize.contract import Rasterizer

SCHEDULED_STEP = 7_501
"""The workload's step: densification counts pulls, as in half of a run, but edits no rows at this one."""

WHOLE, KERNELS = "whole", "kernels"


@dataclass(frozen=True)
class StepRow:
    """One method's step.

    ``whole`` is the step of the training loop; ``stages`` are its parts, timed while it runs; what they leave is the
    loop's own. ``kernels`` are the floor: the compiled rasterizer, loss and Adam on the same inputs, called alone. The
    floor ratios are whole over their sum; without the CPU's rasterizer there is no such floor.
    """

    method: str
    gaussians: int
    whole: Timing
    stages: dict[str, Timing]
    kernels: dict[str, Timing]
    wall_floor_ratio: float | None
    cpu_floor_ratio: float | None


@dataclass(frozen=True)
class StepBench:
    """What ``ringlight bench step`` measured: methods on one scene, in turns."""

    circumstances: Circumstances
    scene: str
    rasterizer: str
    image: str
    rows: tuple[StepRow, ...]


@dataclass(frozen=True)
class Subject:
    """A training at some point of its run; ``step`` is the one that gets repeated."""

    method: str
    scene: str
    training: Training
    step: int

    @property
    def model(self) -> SplatModel:
        """What is trained."""
        return splats_of(self.training, self.method)

    @property
    def batch(self) -> ImageBatch:
        """The photograph of the step."""
        return cast(ImageBatch, self.training.batches.at(self.step))


def splats_of(training: Training, method: str) -> SplatModel:
    """The model that is trained. Raises RecipeError where it is no table of Gaussians, whose parts could be timed."""
    model = training.model.splats()
    if model is None:
        raise RecipeError(f"{method} has no Gaussians, and this benchmark times their parts; name another method")
    return model


def subject_of_workload(method: str, recipe: Recipe, size: Size, rasterize: Rasterizer, seed: int = 0) -> Subject:
    """The method on the standard workload, with every schedule at its end: all harmonics, the light field on."""
    if size.channels != 3:
        raise RecipeError(f"a training step draws 3 channels, not {size.channels}; leave --channels away")
    work = workload(size, seed)
    scene = workload_scene(work, seed)
    recipe, _ = recipe.settled(scene, rasterize, seed)
    training = recipe.build(scene, rasterize, seed)
    model = splats_of(training, method)
    model.load_columns({name: getattr(work.gaussians, name) for name in GEOMETRY})
    # A model made for rendering has everything switched on; only a build for training starts with less.
    finished = recipe.model(scene.box, rasterize)
    shown = finished.state_dict()
    for name, buffer in model.named_buffers():
        if name in shown:
            buffer.copy_(shown[name])
    training.step = min(SCHEDULED_STEP, recipe.steps) - 1
    return Subject(method, f"workload {size.name}", training, training.step + 1)


@dataclass(frozen=True)
class Photographs:
    """A training on photographs, as far as it goes before its step is timed.

    ``after`` steps are done of a run of ``steps`` (0: the method's own); with ``gaussians`` density control ends with
    no more than so many and nothing is dropped, so that methods that grow to the bound have equally many.
    """

    path: Path
    after: int = 0
    steps: int = 0
    gaussians: int = 0


def subject_of_scene(
    method: str, recipe: Recipe, photographs: Photographs, rasterize: Rasterizer, seed: int
) -> Subject:
    """The method on photographs. Raises SceneError, and RecipeError, also for more Gaussians than the bound."""
    if photographs.steps:
        recipe = dataclasses.replace(recipe, steps=photographs.steps)
    if not 0 <= photographs.after < recipe.steps:
        raise RecipeError(f"--after is {photographs.after}; the run has {recipe.steps} steps: give less")
    scene = load_scene(photographs.path, SceneOptions())
    settled, _ = recipe.settled(scene, rasterize, seed)
    if photographs.gaussians:
        settled = settled.ending_with(photographs.gaussians, dropping=False)
    training = settled.build(scene, rasterize, seed)
    for _ in islice(train(training), photographs.after):
        pass
    count = len(splats_of(training, method))
    if photographs.gaussians and count > photographs.gaussians:
        raise RecipeError(
            f"{method} has {count:,} Gaussians after {photographs.after} steps, more than --gaussians "
            f"{photographs.gaussians}; give a later --after, or more"
        )
    where = f"{scene.name} after {photographs.after} steps of {recipe.steps}"
    return Subject(method, where, training, training.step + 1)


def bench_step(subjects: Sequence[Subject], budget: Budget, now: Circumstances) -> StepBench:
    """Repeat one step of each, whole and cut into stages, all in turns; everything is put back before each round, off
    the clock. ``budget`` is each method's. Raises RecipeError where methods are given photographs of different sizes,
    as at the beginning of a run of 3dgs."""
    cameras = [subject.batch.camera for subject in subjects]
    images = [f"{camera.width}x{camera.height}" for camera in cameras]
    if len(set(images)) > 1:
        sizes = ", ".join(f"{subject.method} {image}" for subject, image in zip(subjects, images, strict=True))
        raise RecipeError(f"photographs are of different sizes at that step ({sizes}); give a later --after")
    watches = [Stopwatch(subject.training) for subject in subjects]
    contestants = {
        (subject.method, part): contestant
        for subject, watch in zip(subjects, watches, strict=True)
        for part, contestant in _contestants_of(subject, watch).items()
    }
    timings = interleaved(contestants, Budget(budget.rounds, budget.seconds * len(subjects)))
    first = subjects[0]
    return StepBench(
        circumstances=now,
        scene=first.scene,
        rasterizer=first.model.rasterize.name,
        image=images[0],
        rows=tuple(_row(subject, watch, timings) for subject, watch in zip(subjects, watches, strict=True)),
    )


def _contestants_of(subject: Subject, watch: Stopwatch) -> dict[str, Contestant]:
    training = subject.training
    put_back = _snapshot(training)

    def one_step() -> None:
        next(train(training))
        watch.end_round()

    contestants = {WHOLE: Contestant({WHOLE: one_step}, put_back)}
    if subject.model.rasterize.name == NATIVE:
        # Put back as well, though nothing has changed: caches are then as cold for both.
        contestants[KERNELS] = Contestant(_kernels_alone(subject), put_back)
    return contestants


def _row(subject: Subject, watch: Stopwatch, timings: dict[tuple[str, str], dict[str, Timing]]) -> StepRow:
    whole = timings[subject.method, WHOLE][WHOLE]
    kernels = timings.get((subject.method, KERNELS), {})
    floor = kernels.get(TOTAL)
    return StepRow(
        method=subject.method,
        gaussians=len(subject.model),
        whole=whole,
        stages=watch.timings(),
        kernels=kernels,
        wall_floor_ratio=whole.wall_ms / max(floor.wall_ms, SHORTEST_MS) if floor else None,
        cpu_floor_ratio=whole.cpu_ms / max(floor.cpu_ms, SHORTEST_MS) if floor else None,
    )


def _kernels_alone(subject: Subject) -> dict[str, Callable[[], object]]:
    """The step's kernels on the step's inputs; Adam updates every parameter of the model."""
    training = subject.training
    batch, model = subject.batch, subject.model
    table, compare = model.gaussians, cast(PhotographLoss, training.loss)
    emission = model.color.emit(table, batch.camera, tuple(model.shader.needs), Want.EXACT)
    channels = emission.channels
    behind = torch.nn.functional.pad(batch.background, (0, channels.shape[1] - len(batch.background)))
    raster = RasterKernel(table, channels, batch.camera, behind, model.options, emission.opacity_factor)
    # For channels that the loss does not see any number will do: what a gradient costs does not depend on it.
    by_image = torch.ones_like(raster.image)
    loss = LossKernel(raster.image[:3], compare.targets.of(batch), compare.settings, by_image[:3])
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
