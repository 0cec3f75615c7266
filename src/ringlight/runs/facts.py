"""What a model file or run folder holds, as plain facts, without rendering anything."""

from dataclasses import dataclass
from pathlib import Path

from ringlight.core.raw_bytes import bytes_by_part
from ringlight.errors import ModelFileError, RunError
from ringlight.files.model_file import ModelHeader, read_model_file
from ringlight.files.packed import bytes_stored
from ringlight.files.tensor_file import read_metadata
from ringlight.files.tensor_header import NAMES
from ringlight.measure.report import read_report
from ringlight.methods.store import CAMERAS_PREFIX
from ringlight.runs.folder import RunFolder
from ringlight.runs.going_on import resuming
from ringlight.runs.opened import find_model
from ringlight.runs.record import RunRecord


@dataclass(frozen=True)
class TensorFacts:
    """One tensor of the file: as it is used, and as it is stored; ``packing`` is empty where these are the same."""

    name: str
    dtype: str
    shape: tuple[int, ...]
    bytes: int
    packing: str
    bytes_stored: int


HEADLINE = ("psnr", "ssim_same", "lpips_alex", "train_seconds", "fps")
"""What a run's facts repeat of its report."""


@dataclass(frozen=True)
class RunFacts:
    """What lies around the model in a run folder, and the command that goes on with it, unless it has ended or cannot.

    ``problems``: missing or damaged files, one sentence each.
    """

    folder: str
    scene: str | None
    seed: int | None
    device: str | None
    planned: int | None
    """Steps of the run, with those that were added."""
    psnr: float | None
    ssim_same: float | None
    lpips_alex: float | None
    train_seconds: float | None
    fps: float | None
    has_checkpoint: bool
    resume: str | None
    problems: tuple[str, ...]


@dataclass(frozen=True)
class ModelFacts:
    """A model file. ``bytes_by_part`` is what rendering needs; the cameras it was trained from are not part of it."""

    file: str
    header: ModelHeader
    tensors: tuple[TensorFacts, ...]
    n_cameras: int
    bytes_by_part: dict[str, int]
    bytes_raw: int
    bytes_file: int
    run: RunFacts | None


def facts_of(path: Path) -> ModelFacts:
    """Facts of a model file or of a run folder. Raises ModelFileError or RunError if there is no model to tell of."""
    file, run = find_model(path)
    stored = read_model_file(file)
    rendering = {name: t for name, t in stored.tensors.items() if not name.startswith(CAMERAS_PREFIX)}
    parts = bytes_by_part(rendering)
    tensors = tuple(
        TensorFacts(
            name,
            NAMES[t.dtype],
            tuple(t.shape),
            t.numel() * t.element_size(),
            stored.stored.packing.get(name, ""),
            bytes_stored(stored.stored, name),
        )
        for name, t in sorted(stored.tensors.items())
    )
    return ModelFacts(
        file=str(file),
        header=stored.header,
        tensors=tensors,
        n_cameras=len(stored.tensors.get(f"{CAMERAS_PREFIX}pinholes", ())),
        bytes_by_part=parts,
        bytes_raw=sum(parts.values()),
        bytes_file=file.stat().st_size,
        run=None if run is None else _run_facts(run, stored.header),
    )


def _run_facts(run: RunFolder, header: ModelHeader) -> RunFacts:
    problems: list[str] = []
    record, report, has_checkpoint = None, None, False
    try:
        record = RunRecord.read(run.path)
    except RunError as error:
        problems.append(str(error))
    try:
        # A run that has not ended has no report yet.
        if run.report.exists() or _has_ended(record, header):
            report = read_report(run.path)
    except RunError as error:
        problems.append(str(error))
    for checkpoint in run.checkpoints:
        try:
            read_metadata(checkpoint)
            has_checkpoint = True
        except ModelFileError as error:
            problems.append(str(error))
    can_go_on = record is not None and has_checkpoint and not _has_ended(record, header)
    return RunFacts(
        folder=str(run.path),
        scene=str(record.scene) if record else None,
        seed=record.seed if record else None,
        device=record.device if record else None,
        planned=record.steps if record else None,
        has_checkpoint=has_checkpoint,
        resume=resuming(run.path, record) if record is not None and can_go_on else None,
        problems=tuple(problems),
        **{name: getattr(report, name) if report else None for name in HEADLINE},
    )


def _has_ended(record: RunRecord | None, header: ModelHeader) -> bool:
    return record is not None and header.step >= record.steps
