"""Models on disk that another process may write again, and the curves of their training.

Files of ours take their names only when they are whole, so whatever lies there can be read; a look at one costs a call
of ``stat``.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.errors import RinglightError, RunError
from ringlight.runs.curves import curve_of
from ringlight.runs.imported import PLY, model_of_ply
from ringlight.runs.opened import Opened, find_model, open_model
from ringlight.view.curves import Curves, curves_of

LOOK_SECONDS = 1.0
"""Between two looks at the files."""

Mark = tuple[int, int, int]
"""What tells a file from the one that had its name before."""


class OnDisk:
    """What ``path`` names: a run folder, a model file, or a PLY. ``opened`` is what was read last, ``curves`` those of
    the run, empty for a file alone."""

    def __init__(self, path: Path, device: str):
        """Reads it. Raises RinglightError as the readers do."""
        self.path, self.device = path, device
        if not path.exists():
            raise RunError(f"{path}: there is no such run, model file or scene folder; check the path")
        # Marks are taken before what they stand for is read: what comes meanwhile is newer.
        file, self.run = (path, None) if _is_ply(path) else find_model(path)
        self._model, self._told = _mark(file), self._marks_of_curve()
        self.opened = self._read()
        self.curves = self._read_curves()

    def take_model(self) -> bool:
        """Read the model again if it is another one than before; whether it was. One that is damaged or gone is passed
        over from then on. Raises RinglightError once for a damaged one."""
        mark = _mark(self.opened.file)
        if mark is None or mark == self._model:
            return False
        self._model = mark
        self.opened = self._read()
        return True

    def take_curves(self) -> bool:
        """Read the curves again if they may have changed; whether they may."""
        marks = self._marks_of_curve()
        if marks == self._told:
            return False
        self._told = marks
        self.curves = self._read_curves()
        return True

    @property
    def background(self) -> Float[Tensor, "3"]:
        """The colour behind its Gaussians."""
        return torch.zeros(3) if self.opened.stored.header.scene.background == "black" else torch.ones(3)

    @property
    def words(self) -> str:
        """How far it is, and what it is made of."""
        step = self.opened.stored.header.step
        return f"{f'step {step:,}, ' if step else ''}{self.opened.stored.model.counted()}"

    def _read(self) -> Opened:
        if _is_ply(self.path):
            return Opened(self.path, None, model_of_ply(self.path))
        return open_model(self.path, self.device)

    def _read_curves(self) -> Curves:
        return Curves() if self.run is None else curves_of(curve_of(self.run))

    def _marks_of_curve(self) -> tuple[Mark | None, ...]:
        return () if self.run is None else (_mark(self.run.report), _mark(self.run.checkpoint))


@dataclass(frozen=True)
class News:
    """A sentence on the model ``name``: it was read again, or could not be."""

    name: str
    sentence: str
    is_trouble: bool


class Following:
    """Looks at ``files``, by the names of their models, every LOOK_SECONDS."""

    def __init__(self, files: Mapping[str, OnDisk]):
        self.files = files
        self._titles = {name: f"{name}: {file.words}" for name, file in files.items()}
        self._looked = float("-inf")

    @property
    def title(self) -> str:
        """What is shown: how far each run is, and when it was read again."""
        return "\n".join(self._titles.values())

    @property
    def curves(self) -> dict[str, Curves]:
        """Of the runs, as read last."""
        return {name: file.curves for name, file in self.files.items()}

    def look(self, now: float) -> tuple[list[News], bool]:
        """What has happened since the last look, and whether curves may have changed."""
        if now - self._looked < LOOK_SECONDS:
            return [], False
        self._looked = now
        news: list[News] = []
        for name, file in self.files.items():
            try:
                if file.take_model():
                    told = f"{name}: {file.words}, read again at {time.strftime('%H:%M:%S')}"
                    self._titles[name] = told
                    news.append(News(name, f"{told}; another process has written it", False))
            except RinglightError as error:
                news.append(News(name, f"{error}; what was read before is shown on", True))
        return news, any([file.take_curves() for file in self.files.values()])


def _is_ply(path: Path) -> bool:
    return path.suffix.lower() == PLY and not path.is_dir()


def _mark(path: Path) -> Mark | None:
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size, found.st_ino
