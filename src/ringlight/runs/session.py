"""One training run on disk: steps, saves, and ends with a model; runs/start.py and runs/resume.py make one."""

import time
from collections.abc import Iterator
from dataclasses import dataclass, field

from torch import Tensor

from ringlight.core.command_line import command
from ringlight.core.finite import first_not_finite
from ringlight.core.scene import Scene
from ringlight.data.decode_check import DecodeCheck
from ringlight.data.file_marks import marks_of
from ringlight.errors import DivergedError, OutputError, SceneError
from ringlight.fit.train import Progress, Training, train
from ringlight.measure.machine import source_commit
from ringlight.measure.peak_memory import PeakMemory
from ringlight.methods.store import model_header, save_model, scene_facts
from ringlight.runs.checkpoints import write_checkpoint
from ringlight.runs.clock import Clock
from ringlight.runs.folder import RunFolder
from ringlight.runs.history import History
from ringlight.runs.lock import RunLock
from ringlight.runs.record import RunRecord


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
    marks: str = field(init=False)
    """Of the training photographs, as they are now."""
    commit: str | None = field(default_factory=source_commit, init=False)
    """Of the code when the session began: a checkout may move on under a run."""

    def __post_init__(self) -> None:
        self.marks = marks_of(self.scene.train)
        self.history = History(self.record.recipe.steps)

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
            "step": str(self.training.step),
            "commit": self.commit or "",
            "made_by": self.record.made_by,
            "wall_seconds": repr(self.clock.wall),
            "cpu_seconds": repr(self.clock.cpu),
            "saving_seconds": repr(self.clock.saving),
            "choosing_seconds": repr(self.clock.choosing),
            "peak_bytes": str(self.memory.growth() or 0),
            "training_views": str(len(self.scene.train)),
            "photographs": self.marks,
            "history": self.history.to_text(),
        }
        try:
            self._write(state, facts)
        except OutputError as error:
            if not self.folder.undistorted.is_dir():
                raise OutputError(f"{error}; {self.way_on()}") from error
            self.folder.drop_undistorted()  # they can be made again, and may have taken the room
            try:
                self._write(state, facts)
            except OutputError as again:
                raise OutputError(f"{again}; {self.way_on()}") from again
        self.clock.saving += time.perf_counter() - begun

    def _write(self, state: dict[str, Tensor], facts: dict[str, str]) -> None:
        write_checkpoint(self.folder, state, facts)
        self._good = self.training.step
        self.save_model()
        self._saved_at = self.training.step

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
