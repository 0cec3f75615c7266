"""The pictures of measured views on disk. A picture that cannot be written takes no number away."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from jaxtyping import Float
from torch import Tensor

from ringlight.core.scene import View
from ringlight.errors import OutputError, RinglightError, RunError
from ringlight.files.video import save_image
from ringlight.measure.picture_names import picture_name
from ringlight.runs.folder import make_folder


@dataclass
class KeptPictures:
    """Writes each view as rendered and as photographed, until one cannot be written; ``failure`` then says why."""

    folders: Sequence[tuple[Path, Path]]
    """Where to, of renders and of photographs, each time."""
    failure: RinglightError | None = field(default=None, init=False)

    def __call__(self, view: View, image: Float[Tensor, "H W 3"], truth: Float[Tensor, "H W 3"]) -> None:
        """Keep one view, with pixels in [0, 1]."""
        if self.failure is not None:
            return
        try:
            for renders, truths in self.folders:
                for folder, picture in ((renders, image), (truths, truth)):
                    save_image(make_folder(folder) / picture_name(view.name), picture)
        except (OutputError, RunError) as error:
            self.failure = error

    def refuse_failure(self) -> None:
        """Raises what kept a picture from being written."""
        if self.failure is not None:
            raise self.failure
