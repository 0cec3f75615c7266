"""Undistorted photographs beside a run, so that its later commands need not undistort them again.

A file holds the pixels of one photograph as they are, with a checksum: PNG would take three fifths of the disk, and
five to seven times the time (docs/experiments/lenses.md). Nobody depends on these files. One that is missing, damaged
or made of something else is made anew, and what cannot be written is not kept.
"""

import hashlib
import shutil
from pathlib import Path
from threading import Lock, Thread
from weakref import ReferenceType, ref

import numpy as np
import torch
from jaxtyping import UInt8

from ringlight.errors import ModelFileError, OutputError
from ringlight.files.tensor_file import read_tensors, write_tensors

ROOM_LEFT = 2 << 30
"""Bytes of the disk that are left to the run: three checkpoints of a million Gaussians with 59 numbers each."""

SHARE = 0.25
"""Of the other bytes that a process may fill: a study has many runs."""

MADE_OF, PIXELS = "made_of", "pixels"
"""What a file holds."""

NAME_BYTES = 16
"""Of a BLAKE2b of the photograph's name, which itself may be longer than names of files."""

NOT_WRITTEN = (OutputError, OSError, MemoryError, RuntimeError)
"""Also where no thread can be started any more, as the program is ending."""


class UndistortedFolder:
    """A :class:`~ringlight.data.kept_pixels.Keeper` of files in ``folder``, which is made with the first of them.

    Without a folder it waits for :meth:`begin`: a new run has none before its photographs were looked at. It remembers
    the pixels that somebody else keeps in memory until then; the others are decoded again, and kept then.
    """

    def __init__(self, folder: Path | None = None):
        self.folder = folder
        self._waiting: dict[str, tuple[str, ReferenceType[np.ndarray]]] = {}
        self._thread: Thread | None = None
        self._can_write = True
        self._room: float | None = None  # bytes; once the folder was made
        self._lock = Lock()

    def __reduce__(self) -> tuple[type["UndistortedFolder"], tuple[Path | None]]:
        """For another process: one that waits for nothing."""
        return UndistortedFolder, (self.folder,)

    def begin(self, folder: Path) -> None:
        """Keep files in ``folder`` from now on; what was waiting is written beside the training."""
        with self._lock:
            self.folder = folder
        if self._waiting:
            self._thread = Thread(target=self._write_waiting, args=(folder,), name="undistorted", daemon=True)
            self._thread.start()

    def wait(self) -> None:
        """Until what was waiting is written."""
        if self._thread is not None:
            self._thread.join()

    def find(self, name: str, made_of: str) -> UInt8[np.ndarray, "H W C"] | None:
        """The pixels of that photograph, unless they are not there, damaged, or made of something else."""
        if self.folder is None:
            return None
        try:
            file = read_tensors(_file(self.folder, name), checksum_required=True)
        except (ModelFileError, MemoryError, RuntimeError):
            return None
        pixels = file.tensors.get(PIXELS)
        if file.metadata.get(MADE_OF) != made_of or pixels is None or pixels.dtype != torch.uint8 or pixels.ndim != 3:
            return None
        return pixels.numpy()

    def keep(self, name: str, made_of: str, pixels: UInt8[np.ndarray, "H W C"]) -> None:
        """Write the pixels of that photograph; nothing once that has failed, or while the disk is nearly full."""
        with self._lock:
            folder = self.folder
            if folder is None:
                self._waiting[name] = made_of, ref(pixels)
        if folder is not None:
            self._write(folder, name, made_of, pixels)

    def _write_waiting(self, folder: Path) -> None:
        for name, (made_of, remembered) in self._waiting.items():
            pixels = remembered()
            if pixels is not None:
                self._write(folder, name, made_of, pixels)
        self._waiting.clear()

    def _write(self, folder: Path, name: str, made_of: str, pixels: np.ndarray) -> None:
        if not self._can_write:
            return
        try:
            free = shutil.disk_usage(folder.parent).free - ROOM_LEFT
            room = SHARE * free if self._room is None else min(self._room, free)
            if room < pixels.nbytes:
                return
            if self._room is None:  # once, and no folder above it: what was deleted stays so
                folder.mkdir(exist_ok=True)
            self._room = room - pixels.nbytes
            write_tensors(_file(folder, name), {PIXELS: torch.from_numpy(pixels)}, {MADE_OF: made_of}, flushed=False)
        except NOT_WRITTEN:
            self._can_write = False


def _file(folder: Path, name: str) -> Path:
    summed = hashlib.blake2b(ascii(name).encode(), digest_size=NAME_BYTES)
    return folder / f"{summed.hexdigest()}.safetensors"
