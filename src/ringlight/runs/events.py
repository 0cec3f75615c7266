"""Events for TensorBoard, beside a run: what cannot be written ends them, and never the run."""

import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any

from jaxtyping import Float
from torch import Tensor

from ringlight.errors import BackendError
from ringlight.runs.folder import RunFolder, make_folder

EVENTS = "tensorboard"
"""Folder inside the run."""


class Events:
    """Those of a run after ``step``: events of later ones, of a run that was stopped since, no longer count.

    TensorBoard writes in a thread of its own, and gives what failed there to whoever asks for the next event. ``warn``
    hears of it once, and nothing more is written. Raises BackendError where the library is not there.
    """

    def __init__(self, folder: RunFolder, step: int, warn: Callable[[str], None]):
        writers = event_library()
        self._folder, self._warn = folder.path / EVENTS, warn
        self._writer: Any = None
        self._hook, threading.excepthook = threading.excepthook, self._without_traceback
        try:
            self._writer = writers(str(make_folder(self._folder)), purge_step=step + 1)
        except Exception as error:
            self._give_up(error)

    def numbers(self, values: Mapping[str, float], step: int) -> None:
        """A curve's next point each."""

        def write(writer: Any) -> None:
            for name, value in values.items():
                writer.add_scalar(name, value, step)

        self._try(write)

    def picture(self, name: str, picture: Float[Tensor, "h w 3"], step: int) -> None:
        """Colours from 0 to 1."""
        self._try(lambda writer: writer.add_image(name, picture, step, dataformats="HWC"))

    def close(self) -> None:
        """Write what is still held back."""
        self._try(lambda writer: writer.close())
        self._end()

    def _try(self, write: Callable[[Any], object]) -> None:
        if self._writer is None:
            return
        try:
            write(self._writer)
        except Exception as error:  # of a file system that TensorBoard was given, also no OSError
            with suppress(Exception):
                self._writer.file_writer.close()  # else its thread would try again
            self._give_up(error)

    def _give_up(self, error: Exception) -> None:
        of_system = error.strerror if isinstance(error, OSError) else None
        reason = of_system or " ".join(str(error).split()) or type(error).__name__
        self._end()
        self._warn(f"{self._folder}: cannot be written ({reason}); training goes on without tensorboard")

    def _end(self) -> None:
        self._writer, threading.excepthook = None, self._hook

    def _without_traceback(self, failed: threading.ExceptHookArgs) -> None:
        """What TensorBoard's thread met is told as a sentence."""
        if not type(failed.thread).__module__.startswith("tensorboard."):
            self._hook(failed)


def event_library() -> Any:
    """TensorBoard's class of writers. Raises BackendError where it is not there."""
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        raise BackendError(
            "--tensorboard needs a library that is not installed; run: pip install 'ringlight[tensorboard]'"
        ) from None
    return SummaryWriter
