"""What a person asked to see while a run trains: pictures of one view, and events for TensorBoard.

It looks and never touches: with and without it a run has the same bits. What cannot be shown costs no step.
"""

from collections.abc import Callable

import torch

from ringlight.core.want import Want
from ringlight.core.words import counted
from ringlight.errors import RinglightError
from ringlight.files.video import save_image
from ringlight.fit.train import Progress
from ringlight.runs.events import Events
from ringlight.runs.folder import make_folder
from ringlight.runs.session import Session

PREVIEWS = "previews"
"""Folder inside the run."""


class Watch:
    """Looks at a session after each step: every ``preview`` steps, and after the last, a picture; 0 for none.

    ``warn`` hears a sentence where pictures or events cannot be written: then there are no more, and the run goes on.
    Raises BackendError where events are asked for and the library is not there.
    """

    def __init__(self, session: Session, preview: int, tensorboard: bool, warn: Callable[[str], None]):
        self.session, self.preview, self.warn = session, preview, warn
        self.view = (session.scene.test or session.scene.train)[0]
        self.latest: int | None = None
        """Step of the last picture."""
        self._events = Events(session.folder, session.training.step, warn) if tensorboard else None

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

    def see(self, progress: Progress) -> None:
        """After a step."""
        training = self.session.training
        if progress.step != training.step:
            return  # it went back to an earlier one
        if self.preview and (progress.step % self.preview == 0 or progress.step == training.steps):
            try:
                self._draw(progress.step)
            except RinglightError as error:
                self.preview, self.latest = 0, None
                reason = str(error).partition(";")[0]  # its remedy is another folder, which a run cannot have
                self.warn(f"{reason}; training goes on without previews")
        if self._events is not None:
            self._tell(self._events, progress)

    def tell_test(self, step: int, decibels: float) -> None:
        """The test views' PSNR, where it was measured during the run."""
        if self._events is not None:
            self._events.numbers({"test/psnr": decibels}, step)

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
            self._events.picture("preview", picture, step)

    def _tell(self, events: Events, progress: Progress) -> None:
        points = self.session.history.points
        if not points or points[-1].step != progress.step:
            return
        point = points[-1]
        values = {"training/psnr": point.psnr, "model/counted": point.counted, "training/seconds": point.seconds}
        events.numbers(values | {f"loss/{name}": term.item() for name, term in progress.losses.items()}, progress.step)
