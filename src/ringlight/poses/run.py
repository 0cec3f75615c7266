"""From photographs or a film to a scene with cameras: stages that keep what they have, so that a killed run goes on."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ringlight.core.words import counted
from ringlight.data.colmap_binary import read_images, read_points
from ringlight.data.poses import world_to_camera_from_quaternion
from ringlight.data.unposed import FILMS
from ringlight.errors import RinglightError, RunError, SceneError
from ringlight.files.atomic import write_text, written_atomically
from ringlight.measure.json_record import from_json, to_json
from ringlight.poses.options import PosesOptions
from ringlight.poses.photographs import SceneFolders, photographs_in
from ringlight.poses.picture import Found, draw_cameras
from ringlight.poses.process import require_colmap
from ringlight.poses.report import PosesReport, lens_in_words, why_not
from ringlight.poses.stages import (
    FEWEST,
    Watch,
    Work,
    compare,
    make_folders,
    map_photographs,
    seek_features,
    take_photographs,
)
from ringlight.runs.lock import RunLock

RECORD_NAME, PICTURE_NAME = "poses.json", "cameras.png"


@dataclass(frozen=True)
class Asked:
    """What the cameras were asked of; a run goes on only with the same."""

    source: str
    files: tuple[str, ...]
    options: dict[str, str]


@dataclass(frozen=True)
class PosesRecord:
    """The file ``poses.json``."""

    asked: Asked
    report: PosesReport | None = None


def find_poses(source: Path, out: Path, options: PosesOptions, threads: int, watch: Watch) -> PosesReport:
    """The scene ``out``: ``images/`` and ``sparse/0`` of COLMAP, upright (z), the picture ``cameras.png``.

    A run that was stopped goes on with the stages that it had not ended; one that is complete is not done again.

    Raises:
        SceneError: no photographs, or none that overlap.
        RunError: ``out`` holds something else, another process is at work in it, or COLMAP failed.
        BackendError: pycolmap, or for films av, is not installed.
    """
    require_colmap()
    is_film = source.is_file() and source.suffix.lower() in FILMS
    if source.is_file() and not is_film:
        raise SceneError(f"{source}: is neither a folder nor a film ({' '.join(sorted(FILMS))}); give one of these")
    files = [source] if is_film else photographs_in(source)
    if not is_film and len(files) < FEWEST:
        raise SceneError(f"{source}: {counted(len(files), 'photograph')}, too few to find cameras; take at least 20")
    asked = Asked(str(source.resolve()), _states(files), {key: str(value) for key, value in asdict(options).items()})
    ended = _claim(out, asked)
    if ended is not None:
        return ended
    lock = RunLock(out, "is finding the cameras of this scene")
    try:
        work = Work(SceneFolders(out), options, threads, watch, is_film)
        report = _do(work, source, files)
        write_text(out / RECORD_NAME, to_json(PosesRecord(asked, report)))
        return report
    finally:
        lock.release()


def _states(files: Sequence[Path]) -> tuple[str, ...]:
    """Name, size and time of change of each."""
    states = ((one.name, one.stat() if one.exists() else one.lstat()) for one in files)  # of a link whose file is gone
    return tuple(f"{name} {state.st_size} {state.st_mtime_ns}" for name, state in states)


def _claim(out: Path, asked: Asked) -> PosesReport | None:
    """Make ``out`` this run's folder; returns the report of a complete run."""
    record = out / RECORD_NAME
    if not record.exists():
        if out.exists() and (not out.is_dir() or any(out.iterdir())):
            raise RunError(f"{out}: is not an empty folder; give another one: ringlight poses PHOTOS OUT")
        try:
            out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RunError(f"{out}: cannot be made ({error.strerror}); give another one") from None
        write_text(record, to_json(PosesRecord(asked)))
        return None
    try:
        found = from_json(PosesRecord, record.read_text("utf-8"), str(record))
    except (RinglightError, UnicodeDecodeError) as error:
        raise RunError(f"{record}: is damaged; delete {out}, or give another folder") from error
    different = _difference(found.asked, asked)
    if different:
        raise RunError(f"{out}: holds the cameras of {different}; give another folder, or delete it")
    return found.report


def _difference(ours: Asked, theirs: Asked) -> str | None:
    if ours.source != theirs.source:
        return f"other photographs, those of {ours.source}"
    if ours.files != theirs.files:
        return "these photographs before some were added, removed or changed"
    changed = [
        f"--{key.replace('_', '-')} {value}" for key, value in ours.options.items() if theirs.options[key] != value
    ]
    return f"these photographs with {' '.join(changed)}" if changed else None


def _do(work: Work, source: Path, files: Sequence[Path]) -> PosesReport:
    make_folders(work)
    take_photographs(work, source, files)
    seek_features(work)
    compare(work)
    return _report(work, map_photographs(work))


def _report(work: Work, answer: dict[str, Any]) -> PosesReport:
    database = work.database
    features, matches = database.features(), database.matches()
    models = answer["models"]
    found = set(models[0])
    failed = [why_not(one.name, features, matches, models) for one in work.taken if one.name not in found]
    picture = work.folders.scene / PICTURE_NAME
    total = len(work.taken) + len(work.failed)
    with written_atomically(picture) as file:
        title = f"{len(found)} of {counted(total, 'photograph')}, {counted(answer['points'], 'point')}"
        draw_cameras(_cameras_and_points(work.folders.model), title).save(file, "PNG")
    return PosesReport(
        scene=str(work.folders.scene),
        photographs=total,
        registered=len(found),
        reprojection_error=answer["reprojection_error"],
        points=answer["points"],
        track_length=answer["track_length"],
        models=tuple(len(names) for names in models),
        mapper=answer["mapper"],
        matching=work.matching,
        pairs=work.pairs,
        lenses=tuple(lens_in_words(lens) for lens in answer["lenses"]),
        up=answer["up"],
        picture=str(picture),
        failed=(*work.failed, *failed),
        seconds=work.seconds,
    )


def _cameras_and_points(model: Path) -> Found:
    images = sorted(read_images(model / "images.bin"), key=lambda image: image.name)
    matrices = np.stack([world_to_camera_from_quaternion(one.quaternion, one.translation, one.name) for one in images])
    rotations, translations = matrices[:, :3, :3], matrices[:, :3, 3]
    points = read_points(model / "points3D.bin")
    centers = -np.einsum("vij,vi->vj", rotations, translations)
    return Found(centers, rotations[:, 2], points.positions.numpy().astype(float), points.colors.numpy())
