"""One training run on disk: starts or resumes, saves, and ends with a model and a report."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import ringlight
from ringlight.core.command_line import command
from ringlight.core.finite import first_not_finite
from ringlight.core.scene import Scene
from ringlight.core.words import counted
from ringlight.data.decode_check import DecodeCheck
from ringlight.data.file_marks import change_since, marks_of
from ringlight.data.load import kept_options, load_scene, with_absent_masks_left_out
from ringlight.data.options import SceneOptions
from ringlight.errors import DivergedError, OutputError, RecipeError, RunError, SceneError
from ringlight.fit.train import Progress, Training, train
from ringlight.measure.peak_memory import PeakMemory
from ringlight.methods.recipe import Recipe
from ringlight.methods.store import model_header, save_model, scene_facts
from ringlight.rasterize.choose import rasterizer_for
from ringlight.runs.checkpoints import read_checkpoint, refuse_misfits, write_checkpoint
from ringlight.runs.clock import Clock
from ringlight.runs.folder import RunFolder
from ringlight.runs.history import History
from ringlight.runs.limits import prepare_run
from ringlight.runs.lock import RunLock
from ringlight.runs.record import LARGEST_SEED, RECORD_NAME, RunRecord
from ringlight.runs.starting_points import with_points_of
from ringlight.runs.undistorted import UndistortedFolder
from ringlight.runs.warm_start import read_start

Loaded = Callable[[str, Scene], None]
"""Called with the method's name and the scene that was read."""


def nobody(preset: str, scene: Scene) -> None:
    """Hears of a scene, and says nothing."""


@dataclass(eq=False, repr=False)
class Session:
    """Iterate over :meth:`steps` to train; stop asking to pause; :meth:`save` whenever you like.

    No other process can train the run until the session's ``lock`` is released, or the session is gone.
    """

    folder: RunFolder
    record: RunRecord
    scene: Scene
    training: Training
    clock: Clock
    lock: RunLock
    memory: PeakMemory
    photographs: DecodeCheck
    warnings: tuple[str, ...]
    decided: str | None = None
    _good: int = -1
    """Step of the last checkpoint."""
    _saved_at: int = field(default=-1, init=False)
    """Step of the last files, the model's among them."""
    history: History = field(init=False)
    """How the training went so far."""
    _marks: str = field(init=False)
    """Of the training photographs, as they are now."""

    def __post_init__(self) -> None:
        self._marks = marks_of(self.scene.train)
        self.history = History(self.record.recipe.steps)

    @staticmethod
    def start(
        out: Path,
        scene_path: Path,
        preset: str,
        recipe: Recipe,
        options: SceneOptions,
        seed: int,
        device: str,
        model: Path | None = None,
        loaded: Loaded = nobody,
    ) -> "Session":
        """A new run, from a ``model`` or PLY if one is named; its checkpoint of step 0 then holds what it starts from.

        Everything that can be wrong with the request is found before the folder is made. ``loaded`` hears of the scene
        before anything is tried on it, which may take long.
        """
        if recipe.steps < 1:
            raise RecipeError(f"--steps is {recipe.steps}; give at least 1")
        if not 0 <= seed <= LARGEST_SEED:
            raise RecipeError(f"--seed is {seed}; give a whole number from 0 to {LARGEST_SEED}")
        memory = PeakMemory()
        options = kept_options(scene_path, with_points_of(recipe, options))
        start = None if model is None else read_start(model)
        undistorted = UndistortedFolder()
        scene = load_scene(scene_path, options, undistorted)
        loaded(preset, scene)
        photographs = DecodeCheck(scene)
        run = prepare_run(scene, recipe, seed, device, start)
        photographs.refuse_damaged()
        options = with_absent_masks_left_out(options, scene)
        record = RunRecord(preset, run.recipe, scene_path.resolve(), options, seed, device, ringlight.__version__)
        if model is not None:
            record = replace(record, start=str(model.resolve()))
        folder = RunFolder.create(out)
        lock = RunLock(folder.path)
        record.write(folder.path)
        undistorted.begin(folder.undistorted)
        clock = Clock(choosing=run.choosing + photographs.cpu_seconds)
        session = Session(
            folder, record, run.scene, run.training, clock, lock, memory, photographs, run.warnings, run.decided
        )
        if model is not None:
            session.save()
        return session

    @staticmethod
    def resume(path: Path, more: int = 0, loaded: Loaded = nobody) -> "Session":
        """Go on with a run where its last checkpoint was written, with the same bits as if it had never stopped.

        With ``more`` the run has so many steps behind its last, and its record says so from now on.
        Where that one is damaged, ``warnings`` says so and the one before it is used; a run without any begins again.
        Raises RunError if the scene has other training views now, or another process trains this run; ModelFileError if
        all checkpoints are damaged.
        """
        folder = RunFolder.open(path)
        record = RunRecord.read(path)
        lock = RunLock(path)
        folder.sweep()
        extended = record.extended(more) if more else record
        memory = PeakMemory()
        if not record.scene.is_dir():
            remedy = f'put it back, or correct "scene" in {folder.path / RECORD_NAME}'
            raise RunError(f"{record.scene}: the scene of {path} is gone; {remedy}")
        if not folder.checkpoints and not folder.model.is_file():  # a model is not trained anew in its place
            return Session._from_step_0(folder, record, lock, memory, loaded)._extended(extended)
        stored, warnings = read_checkpoint(folder)
        scene = load_scene(record.scene, record.options, UndistortedFolder(folder.undistorted))
        loaded(record.preset, scene)
        photographs = DecodeCheck(scene)
        training = record.recipe.build(scene, rasterizer_for(record.device), record.seed)
        for added in record.added:
            training.extend(added)
        try:
            refuse_misfits(stored.tensors, training)
            training.restore(stored.tensors)
            if training.step > training.steps:
                raise ValueError(f"step {training.step} of {training.steps}")
            wall, cpu, saving = (float(stored.metadata[f"{name}_seconds"]) for name in ("wall", "cpu", "saving"))
            clock = Clock(wall, cpu, saving, float(stored.metadata.get("choosing_seconds", 0)))
            views = int(stored.metadata["training_views"])
            session = Session(
                folder, record, scene, training, clock, lock, memory, photographs, warnings, _good=training.step
            )
            session.history.go_on_from(stored.metadata)
            memory.earlier = int(stored.metadata["peak_bytes"]) or None
        except (KeyError, RuntimeError, ValueError) as error:
            raise RunError(
                f"{folder.checkpoint}: does not fit {folder.path / RECORD_NAME} ({error}); it is another run's, or "
                "another version of ringlight wrote it: put this run's own back, or start again with --out NEW"
            ) from None
        if views != len(scene.train):
            raise RunError(
                f"{record.scene}: has {counted(len(scene.train), 'training view')} where {path} began with {views}; "
                "put the photographs back as they were, or start again with --out NEW"
            )
        session.warnings += change_since(stored.metadata.get("photographs", ""), scene.train)
        return session._extended(extended)

    def _extended(self, record: RunRecord) -> "Session":
        """This run by ``record``, which may have more steps."""
        if record != self.record:
            record.write(self.folder.path)
            self.training.extend(record.added[-1])
            self.record = record
        return self

    @staticmethod
    def _from_step_0(
        folder: RunFolder, record: RunRecord, lock: RunLock, memory: PeakMemory, loaded: Loaded
    ) -> "Session":
        """The run that ``record`` describes, which ended before its first checkpoint.

        Raises RunError for one that started from a model: what it was to start from was not saved.
        """
        if record.start is not None:
            raise RunError(
                f"{folder.path}: ended before its start from {record.start} was saved; start it again with --out NEW"
            )
        scene = load_scene(record.scene, record.options, UndistortedFolder(folder.undistorted))
        loaded(record.preset, scene)
        photographs = DecodeCheck(scene)
        run = prepare_run(scene, record.recipe, record.seed, record.device)
        for added in record.added:
            run.training.extend(added)
        # What it took before is not known: neither this nor the trial is recorded.
        clock = Clock(choosing=run.choosing + photographs.cpu_seconds)
        return Session(folder, record, run.scene, run.training, clock, lock, memory, photographs, run.warnings)

    def steps(self) -> Iterator[Progress]:
        """The training steps that remain; the clock runs only while a step runs.

        Raises SceneError, as soon as it is known, for a photograph that is damaged; it says where the run can go on.
        """
        steps = train(self.training)
        while True:
            wall, cpu = time.perf_counter(), time.process_time()
            try:
                self.photographs.refuse_damaged()
                progress = next(steps, None)
            except SceneError as error:
                raise SceneError(f"{error}; {self.way_on()}") from error
            self.clock.wall += time.perf_counter() - wall
            self.clock.cpu += time.process_time() - cpu
            if progress is None:
                return
            if progress.collapse is not None:
                self._saved_at = -1  # a step that was saved may come again, with other bits
            self.history.note(progress, self.clock.wall, self.training.model.counted().number)
            yield progress

    def save(self) -> None:
        """Write the checkpoint and the model as it is now; nothing if that has been done at this step.

        Raises OutputError, or DivergedError for a model that is not finite; both say where the run can go on.
        """
        if self._saved_at == self.training.step:
            return
        begun = time.perf_counter()
        state = self.training.state()
        broken = first_not_finite(state)
        if broken is not None:
            raise DivergedError(f"{broken} and is not saved; {self.way_on()}")
        facts = {
            "program": "ringlight checkpoint",
            "wall_seconds": repr(self.clock.wall),
            "cpu_seconds": repr(self.clock.cpu),
            "saving_seconds": repr(self.clock.saving),
            "choosing_seconds": repr(self.clock.choosing),
            "peak_bytes": str(self.memory.growth() or 0),
            "training_views": str(len(self.scene.train)),
            "photographs": self._marks,
            "history": self.history.to_text(),
        }
        try:
            write_checkpoint(self.folder, state, facts)
            self._good = self.training.step
            self.save_model()
            self._saved_at = self.training.step
        except OutputError as error:
            raise OutputError(f"{error}; {self.way_on()}") from error
        self.clock.saving += time.perf_counter() - begun

    def way_on(self) -> str:
        """What a run that cannot be saved at this step has lost."""
        step, resume = self.training.step, command("train", "--resume", self.folder.path)
        if self._good < 0 or not self.folder.checkpoints:
            again = f"; begin again with: {resume}" if self.folder.recorded else ""
            if self.record.start is not None:  # what it starts from lies in its first checkpoint
                again = "; start it again with --out NEW"
            return f"stopped after step {step} without a checkpoint{again}"
        last = f"the last good checkpoint is of step {self._good}"
        return f"stopped after step {step}; {last}, go on with: {resume}"

    def save_model(self, metrics: dict[str, object] | None = None) -> None:
        """Write the model file, with the test views' numbers if there are any."""
        facts = scene_facts(self.scene, self.record.options)
        header = model_header(self.record.preset, self.record.recipe, self.training.step, facts, metrics)
        cameras = [view.camera for view in self.scene.train]
        save_model(self.folder.model, self.training.model, header, cameras)
