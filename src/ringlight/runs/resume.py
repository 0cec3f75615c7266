"""A run that goes on: from its last checkpoint, or from its first step where it ended before there was one."""

from pathlib import Path

from ringlight.core.command_line import command
from ringlight.core.scene import Scene
from ringlight.core.words import counted
from ringlight.data.decode_check import DecodeCheck
from ringlight.data.file_marks import change_since
from ringlight.data.load import load_scene
from ringlight.errors import BackendError, RunError
from ringlight.files.tensor_file import TensorFile
from ringlight.fit.train import Training
from ringlight.measure.peak_memory import PeakMemory
from ringlight.rasterize.choose import has_gpu, rasterizer_for
from ringlight.runs.checkpoints import read_checkpoint, refuse_misfits
from ringlight.runs.clock import Clock
from ringlight.runs.folder import RunFolder
from ringlight.runs.limits import prepare_run
from ringlight.runs.lock import RunLock
from ringlight.runs.record import RECORD_NAME, RunRecord
from ringlight.runs.session import Session
from ringlight.runs.start import Loaded, nobody
from ringlight.runs.undistorted import UndistortedFolder


def resume_run(path: Path, more: int = 0, loaded: Loaded = nobody) -> Session:
    """Go on with a run where its last checkpoint was written, with the same bits as if it had never stopped.

    With ``more`` the run has so many steps behind its last, and its record says so from now on.
    Where that one is damaged, ``warnings`` says so and the one before it is used; a run without any begins again.
    Raises RunError if the scene has other training views now, or another process trains this run; ModelFileError if
    all checkpoints are damaged; BackendError where it needs a GPU that is not there.
    """
    folder = RunFolder.open(path)
    record = RunRecord.read(path)
    _refuse_without_gpu(path, record)
    lock = RunLock(path)
    folder.sweep()
    extended = record.extended(more) if more else record
    memory = PeakMemory()
    if not record.scene.is_dir():
        remedy = f'put it back, or correct "scene" in {folder.path / RECORD_NAME}'
        raise RunError(f"{record.scene}: the scene of {path} is gone; {remedy}")
    if not folder.checkpoints and not folder.model.is_file():  # a model is not trained anew in its place
        return _extended(_from_step_0(folder, record, lock, memory, loaded), extended)
    stored, warnings = read_checkpoint(folder)
    _refuse_another(stored, folder, record)
    scene, photographs = _reloaded(folder, record, loaded)
    training = _with_added(record.recipe.build(scene, rasterizer_for(record.device), record.seed), record)
    try:
        clock, views = _restored(stored, training)
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
    session.warnings += change_since(stored.metadata.get("photographs", ""), session.marks, scene.train)
    return _extended(session, extended)


def _refuse_without_gpu(path: Path, record: RunRecord) -> None:
    """Raises BackendError, before photographs are read, for a run on a GPU where there is none."""
    if record.device == "cuda" and not has_gpu():
        again = command("train", record.scene, record.preset)
        raise BackendError(
            f"{path}: was begun with --device cuda, which a resumed run keeps, and torch finds no NVIDIA GPU on this "
            f"machine; go on where there is one, or start again: {again} --device cpu --out NEW"
        )


def _reloaded(folder: RunFolder, record: RunRecord, loaded: Loaded) -> tuple[Scene, DecodeCheck]:
    scene = load_scene(record.scene, record.options, UndistortedFolder(folder.undistorted))
    loaded(record.preset, scene)
    return scene, DecodeCheck(scene)


def _with_added(training: Training, record: RunRecord) -> Training:
    """Its steps and those that were added later."""
    for added in record.added:
        training.extend(added)
    return training


def _refuse_another(stored: TensorFile, folder: RunFolder, record: RunRecord) -> None:
    """Raises RunError for a checkpoint whose shapes may fit, but which another run wrote; earlier versions did not say
    which."""
    made_by = stored.metadata.get("made_by", record.made_by)
    if made_by != record.made_by:
        raise RunError(
            f"{folder.checkpoint}: is of {made_by}, and {folder.path / RECORD_NAME} of {record.made_by}; put this "
            "run's own back, or start again with --out NEW"
        )


def _restored(stored: TensorFile, training: Training) -> tuple[Clock, int]:
    """Put the training where the checkpoint has it; its clock, and how many views it was trained on.

    Raises KeyError, RuntimeError or ValueError where the checkpoint is not of this training.
    """
    refuse_misfits(stored.tensors, training)
    training.restore(stored.tensors)
    if training.step > training.steps:
        raise ValueError(f"step {training.step} of {training.steps}")
    wall, cpu, saving = (float(stored.metadata[f"{name}_seconds"]) for name in ("wall", "cpu", "saving"))
    clock = Clock(wall, cpu, saving, float(stored.metadata.get("choosing_seconds", 0)))
    return clock, int(stored.metadata["training_views"])


def _extended(session: Session, record: RunRecord) -> Session:
    """This run by ``record``, which may have more steps."""
    if record != session.record:
        record.write(session.folder.path)
        session.training.extend(record.added[-1])
        session.record = record
    return session


def _from_step_0(folder: RunFolder, record: RunRecord, lock: RunLock, memory: PeakMemory, loaded: Loaded) -> Session:
    """The run that ``record`` describes, which ended before its first checkpoint.

    Raises RunError for one that started from a model: what it was to start from was not saved.
    """
    if record.start is not None:
        raise RunError(
            f"{folder.path}: ended before its start from {record.start} was saved; begin it again in another folder, "
            "as by --out NEW"
        )
    scene, photographs = _reloaded(folder, record, loaded)
    run = prepare_run(scene, record.recipe, record.seed, record.device)
    training = _with_added(run.training, record)
    # What it took before is not known: neither this nor the trial is recorded.
    clock = Clock(choosing=run.choosing + photographs.cpu_seconds)
    return Session(folder, record, run.scene, training, clock, lock, memory, photographs, run.warnings)
