"""Where a run keeps its files, and the rule that no run overwrites another."""

import shutil
from dataclasses import dataclass
from pathlib import Path

from ringlight.core.command_line import command
from ringlight.core.lost_disk import what_helps
from ringlight.errors import RunError
from ringlight.files.atomic import sweep
from ringlight.measure.picture_names import RENDERS, TRUTHS
from ringlight.measure.report import REPORT_NAME
from ringlight.runs.record import RECORD_NAME

MODEL_NAME = "model.safetensors"
CHECKPOINT_NAME = "checkpoint.safetensors"
EARLIER_NAME = "checkpoint-earlier.safetensors"
FRESH_NAME = "checkpoint-fresh.safetensors"


@dataclass(frozen=True)
class RunFolder:
    """``recipe.json``, ``checkpoint.safetensors``, ``model.safetensors``, ``report.json`` and ``images/``;
    ``undistorted/`` where photographs were."""

    path: Path

    @property
    def model(self) -> Path:
        """The trained model."""
        return self.path / MODEL_NAME

    @property
    def checkpoint(self) -> Path:
        """Where the run can go on from."""
        return self.path / CHECKPOINT_NAME

    @property
    def checkpoints(self) -> list[Path]:
        """All that are there, the newest first; the fresh one has that name only where its writer was killed."""
        paths = [self.path / name for name in (FRESH_NAME, CHECKPOINT_NAME, EARLIER_NAME)]
        return [path for path in paths if path.is_file()]

    @property
    def recorded(self) -> bool:
        """Whether it holds what the run is: its scene, recipe and seed."""
        return (self.path / RECORD_NAME).is_file()

    @property
    def report(self) -> Path:
        """The numbers."""
        return self.path / REPORT_NAME

    @property
    def pictures(self) -> tuple[Path, Path]:
        """Folders of the test views as 8-bit PNG: as the model shows them, and as photographed."""
        return self.path / RENDERS, self.path / TRUTHS

    @property
    def undistorted(self) -> Path:
        """Folder of photographs that were undistorted; nobody depends on it."""
        return self.path / "undistorted"

    def drop_undistorted(self) -> None:
        """Remove the photographs that were undistorted, as far as they may be removed."""
        shutil.rmtree(self.undistorted, ignore_errors=True)

    def sweep(self) -> None:
        """Remove what killed writers left half done; nobody may be writing into the run meanwhile."""
        for folder in (self.path, self.undistorted):
            sweep(folder)

    @staticmethod
    def create(path: Path) -> "RunFolder":
        """A new, empty run folder. Raises RunError if it holds anything: nothing is ever overwritten."""
        refuse_taken(path)
        return RunFolder(empty_folder(path))

    @staticmethod
    def open(path: Path) -> "RunFolder":
        """An existing run folder. Raises RunError if there is none."""
        if not path.is_dir():
            raise RunError(
                f"{path}: no such run folder; give the folder of a run, which 'ringlight train' or 'relight' wrote"
            )
        return RunFolder(path)


def outdated_report(model: Path) -> Path | None:
    """The report of the run whose own model file ``model`` is; None for any other file, or without a report."""
    folder = RunFolder(model.parent)
    return folder.report if model.name == MODEL_NAME and folder.recorded and folder.report.is_file() else None


def refuse_taken(path: Path, relights: bool = False) -> None:
    """Raises RunError for a folder that holds anything, for those who work long before they make it; the remedy is that
    of the command."""
    if (path / RECORD_NAME).exists():
        verb = "relight" if relights else "train"
        new = "another OUT" if relights else "--out NEW"
        raise RunError(f"{path}: already holds a run; give {new}, or go on with it: {command(verb, '--resume', path)}")
    _refuse_filled(path, "--out")


def empty_folder(path: Path, flag: str = "--out", or_else: str = "") -> Path:
    """``path``, which ``flag`` named, as an empty folder, made if need be. Raises RunError if it holds anything:
    nothing is overwritten. ``or_else`` names one more remedy."""
    _refuse_filled(path, flag, or_else)
    return make_folder(path, flag)


def _refuse_filled(path: Path, flag: str, or_else: str = "") -> None:
    if path.exists() and (not path.is_dir() or any(path.iterdir())):
        more = f", or {or_else}" if or_else and path.is_dir() else ""
        raise RunError(f"{path}: is not an empty folder; give another one with {flag}{more}")


def make_folder(path: Path, flag: str = "--out") -> Path:
    """``path`` as a folder, with the folders above it. Raises RunError if it cannot be made."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _not_made(path, error, flag) from None
    return path


def refuse_file_in_the_way(path: Path, flag: str = "--out") -> None:
    """Raises RunError where a file stands at ``path`` or above it, for those who make no folder yet."""
    there = next(place for place in (path, *path.parents) if place.exists() or not place.name)
    if not there.is_dir():
        raise RunError(f"{path}: cannot be made ({there} is a file); give another folder with {flag}")


def make_free_folder(wish: Path) -> Path:
    """The folder, or with the first number behind it that is free, made: of two that ask at once each gets its own.
    Raises RunError if it cannot be made."""
    make_folder(wish.parent)
    number, folder = 2, wish
    while True:
        try:
            folder.mkdir()
            return folder
        except FileExistsError:
            folder, number = wish.with_name(f"{wish.name}-{number}"), number + 1
        except OSError as error:
            raise _not_made(folder, error, "--out") from None


def _not_made(path: Path, error: OSError, flag: str) -> RunError:
    give = what_helps(error, f"give another folder with {flag}")
    return RunError(f"{path}: cannot be made ({error.strerror}); {give}")
