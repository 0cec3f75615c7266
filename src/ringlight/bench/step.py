"""Speed of a whole training step, and of its stages: what Python and torch add to the kernels."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from ringlight.bench.record import Circumstances
from ringlight.bench.stopwatch import Stopwatch
from ringlight.bench.timing import Budget, Contestant, Timing, interleaved
from ringlight.bench.workload import Size, workload, workload_scene
from ringlight.core.gaussians import GEOMETRY
from ringlight.core.words import counted
from ringlight.data.batches import ImageBatch
from ringlight.data.bundled import scene_folder
from ringlight.data.load import load_scene
from ringlight.data.options import SceneOptions
from ringlight.errors import RecipeError
from ringlight.fit.train import Training, train
from ringlight.methods.recipe import Recipe
from ringlight.models.splats import SplatModel
from ringlight.rasterize.contract import Rasterizer

SCHEDULED_STEP = 7_501
"""The workload's step: densification sums gradients, as in half of a run, but edits no rows at this one."""

WHOLE, PIXELS = "whole", "pixels"


@dataclass(frozen=True)
class StepRow:
    """One method's step.

    ``gaussians`` is how many it has of these, or of what else it is made of, as ``noun`` says. ``whole`` is the step of
    the training loop; ``stages`` are its parts, timed while it runs. What they leave of it is the loop's own.
    """

    method: str
    gaussians: int
    whole: Timing
    stages: dict[str, Timing]
    noun: str = "Gaussians"


@dataclass(frozen=True)
class StepBench:
    """What ``ringlight bench step`` measured: methods on one scene, in turns."""

    circumstances: Circumstances
    scene: str
    renderer: str
    image: str
    rows: tuple[StepRow, ...]


@dataclass(frozen=True)
class Subject:
    """A training at some point of its run; the step that comes next is the one that gets repeated."""

    method: str
    scene: str
    training: Training

    @property
    def looks_at(self) -> str:
        """What its next step sees of the photographs: "400x400 pixels" of one, or "a lot of 4,096 rays"."""
        batch = self.training.batches.at(self.training.step + 1)
        if isinstance(batch, ImageBatch):
            return f"{batch.camera.width}x{batch.camera.height} {PIXELS}"
        return batch.label


def splats_of(training: Training, method: str) -> SplatModel:
    """The model that is trained. Raises RecipeError where it is no table of Gaussians."""
    model = training.model.splats()
    if model is None:
        raise RecipeError(f"{method} has no Gaussians, of which the standard workload is; time its step on a --scene")
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
    return Subject(method, f"workload {size.name}", training)


def subject_of_scene(
    method: str,
    recipe: Recipe,
    photographs: Path,
    rasterize: Rasterizer,
    seed: int,
    *,
    after: int = 0,
    steps: int = 0,
    gaussians: int = 0,
) -> Subject:
    """The method on photographs, when ``after`` steps are done of a run of ``steps`` (0: the method's own).

    With ``gaussians`` density control ends with no more than so many and nothing is dropped, so that methods that grow
    to the bound have equally many. Raises SceneError, and RecipeError, also for more Gaussians than the bound.
    """
    if steps:
        recipe = dataclasses.replace(recipe, steps=steps)
    if after >= recipe.steps:
        raise RecipeError(f"--after is {after}; the run has {counted(recipe.steps, 'step')}: give less")
    scene = load_scene(scene_folder(photographs), SceneOptions())
    settled, _ = recipe.settled(scene, rasterize, seed)
    if gaussians:
        settled = settled.ending_with(gaussians, dropping=False)
    training = settled.build(scene, rasterize, seed)
    for _ in islice(train(training), after):
        pass
    count, noun = training.model.counted()
    if gaussians and noun == "Gaussians" and count > gaussians:
        raise RecipeError(
            f"{method} has {counted(count, 'Gaussian')} after {counted(after, 'step')}, more than --gaussians "
            f"{gaussians}; give a later --after, or more"
        )
    return Subject(method, f"{scene.name} after {counted(after, 'step')} of {recipe.steps:,}", training)


def bench_step(subjects: Sequence[Subject], budget: Budget, now: Circumstances) -> StepBench:
    """Repeat one step of each, whole and cut into stages, all in turns; everything is put back before each round, off
    the clock. ``budget`` is each method's. Raises RecipeError where methods are given photographs of different sizes,
    as at the beginning of a run of 3dgs."""
    seen = {subject.method: subject.looks_at for subject in subjects}
    if len({looks_at for looks_at in seen.values() if looks_at.endswith(PIXELS)}) > 1:
        sizes = ", ".join(f"{method} {looks_at}" for method, looks_at in seen.items())
        raise RecipeError(f"photographs are of different sizes at that step ({sizes}); give a later --after")
    watches = [Stopwatch(subject.training) for subject in subjects]
    contestants = {s.method: _contestant(s, watch) for s, watch in zip(subjects, watches, strict=True)}
    timings = interleaved(contestants, Budget(budget.rounds, budget.seconds * len(subjects)))
    return StepBench(
        circumstances=now,
        scene=subjects[0].scene,
        renderer=", ".join(dict.fromkeys(subject.training.model.renderer for subject in subjects)),
        image=", ".join(dict.fromkeys(seen.values())),
        rows=tuple(
            _row(subject, timings[subject.method][WHOLE], watch)
            for subject, watch in zip(subjects, watches, strict=True)
        ),
    )


def _row(subject: Subject, whole: Timing, watch: Stopwatch) -> StepRow:
    count, noun = subject.training.model.counted()
    return StepRow(subject.method, count, whole, watch.timings(), noun)


def _contestant(subject: Subject, watch: Stopwatch) -> Contestant:
    def one_step() -> None:
        next(train(subject.training))
        watch.end_round()

    # Parameters, moments, counters, and the step.
    kept = {name: tensor.detach().clone() for name, tensor in subject.training.state().items()}
    return Contestant({WHOLE: one_step}, prepare=lambda: subject.training.restore(kept))
