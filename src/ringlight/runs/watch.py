"""What a person asked to see while a run trains: pictures of one view, and events for TensorBoard.

It looks and never touches: with and without it a run has the same bits.
"""

from typing import Any

import torch

from ringlight.core.want import Want
from ringlight.core.words import counted
from ringlight.errors import BackendError, OutputError, RunError
from ringlight.files.video import save_image
from ringlight.fit.train import Progress
from ringlight.runs.folder import make_folder
from ringlight.runs.session import Session

PREVIEWS, EVENTS = "previews", "tensorboard"
"""Folders inside the run."""


class Watch:
    """Looks at a session after each step: every ``preview`` steps, and after the last, a picture; 0 for none.

    Raises BackendError where events are asked for and the library is not there.
    """

    def __init__(self, session: Session, preview: int, tensorboard: bool):
        self.session, self.preview = session, preview
        self.view = (session.scene.test or session.scene.train)[0]
        self.latest: int | None = None
        """Step of the last picture."""
        self._events = _event_writer(session) if tensorboard else None

    @property
    def about(self) -> str:
        """Which view is shown, and where its pictures lie; empty without them."""
        if not self.preview:
            return ""
        kind = "test" if self.session.scene.test else "training"
        folder = self.session.folder.path / PREVIEWS
        return f"a preview every {counted(self.preview, 'step')}: {kind} view {self.view.name}, in {folder}/step-*.png"

    @property
    def words(self) -> str:
        """For the progress line: the last picture."""
        return "" if self.latest is None else f"preview {self.latest}"

    def see(self, progress: Progress) -> str | None:
        """After a step. A sentence where a picture cannot be written: then there are no more, and the run goes on."""
        training = self.session.training
        if progress.step != training.step:
            return None  # it went back to an earlier one
        trouble = None
        if self.preview and (progress.step % self.preview == 0 or progress.step == training.steps):
            try:
                self._draw(progress.step)
            except (OutputError, RunError) as error:
                self.preview, self.latest = 0, None
                reason = str(error).partition(";")[0]  # its remedy is another folder, which a run cannot have
                trouble = f"{reason}; training goes on without previews"
        if self._events is not None:
            self._tell(self._events, progress)
        return trouble

    def tell_test(self, step: int, decibels: float) -> None:
        """The test views' PSNR, where it was measured during the run."""
        if self._events is not None:
            self._events.add_scalar("test/psnr", decibels, step)

    def close(self) -> None:
        """Write what is still held back."""
        if self._events is not None:
            self._events.close()

    @torch.no_grad()
    def _draw(self, step: int) -> None:
        model, background = self.session.training.model, self.session.scene.background_color
        picture = model.render(self.view.camera, background, Want.PICTURE).color.cpu().clamp(0, 1)
        path = make_folder(self.session.folder.path / PREVIEWS) / f"step-{step:06d}.png"
        save_image(path, picture)
        self.latest = step
        if self._events is not None:
            self._events.add_image("preview", picture, step, dataformats="HWC")

    def _tell(self, events: Any, progress: Progress) -> None:
        points = self.session.history.points
        if not points or points[-1].step != progress.step:
            return
        point = points[-1]
        values = {"training/psnr": point.psnr, "model/counted": point.counted, "training/seconds": point.seconds}
        values |= {f"loss/{name}": term.item() for name, term in progress.losses.items()}
        for name, value in values.items():
            events.add_scalar(name, value, progress.step)


def event_library() -> Any:
    """TensorBoard's class of writers. Raises BackendError where it is not there."""
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        raise BackendError(
            "--tensorboard needs a library that is not installed; run: pip install 'ringlight[tensorboard]'"
        ) from None
    return SummaryWriter


def _event_writer(session: Session) -> Any:
    """TensorBoard's writer; events after the step at hand, of a run that was stopped later, no longer count."""
    folder = make_folder(session.folder.path / EVENTS)
    return event_library()(str(folder), purge_step=session.training.step + 1)
