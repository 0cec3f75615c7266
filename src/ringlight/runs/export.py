"""A trained model in the form that other programs open; the suffix of the file says which."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from torch import Tensor

import ringlight
from ringlight.errors import ModelFileError, OutputError
from ringlight.files.atomic import refuse_existing
from ringlight.files.formats.contract import Content, Form
from ringlight.files.formats.table import WRITERS
from ringlight.methods.store import StoredModel
from ringlight.models.contract import Count
from ringlight.models.splats import SplatModel
from ringlight.runs.as_harmonics import BakingLoss, exact_harmonics, fitted_harmonics

FIT_STEPS = 200
"""Pictures that baked harmonics are fitted to: 8.7 dB on family_24 lit per pixel, where 200 more are worth 0.3."""


@dataclass(frozen=True)
class Exported:
    """What was written; ``loss`` is what fitted harmonics miss, None where nothing was fitted."""

    file: str
    counted: int
    noun: str
    bytes_file: int
    loss: BakingLoss | None


def check_target(path: Path, overwrite: bool) -> None:
    """Raises OutputError for a suffix that cannot be written, or a file that exists and may not be replaced."""
    if path.suffix.lower() not in WRITERS:
        raise OutputError(f"{path}: cannot be written: unknown kind of model; end its name in {' or '.join(WRITERS)}")
    refuse_existing(path, overwrite)


def export(stored: StoredModel, path: Path, fit_steps: int = FIT_STEPS) -> Exported:
    """Write the model by the writer of the path's suffix, which is in the table.

    Gaussians that the model does not show are left out, and opacity factors become part of the opacity. Raises
    OutputError where the model has no such form, or the file cannot be written, ModelFileError if harmonics cannot be
    fitted because the model comes without cameras.
    """
    writer, splats = WRITERS[path.suffix.lower()], stored.model.splats()
    count, _ = stored.model.rendering_size()
    loss: BakingLoss | None = None
    if writer.form is Form.OWN:
        tensors: Mapping[str, Tensor] = stored.model.rendering_tensors()
    elif splats is None:
        raise OutputError(
            f"{path}: cannot be written: it holds {writer.form.value}, and this model is made of {count.noun}; "
            "'ringlight render' makes pictures of it"
        )
    else:
        tensors, loss = _harmonics(stored, splats, path, writer.form, fit_steps)
        count = Count(len(tensors["means"]), count.noun)
    note = f"ringlight {ringlight.__version__}, {stored.header.preset}, {stored.header.scene.name}"
    writer.write(path, Content(tensors, splats is not None and splats.options.antialiased, (note,)))
    return Exported(str(path), count.number, count.noun, path.stat().st_size, loss)


def _harmonics(
    stored: StoredModel, splats: SplatModel, path: Path, form: Form, fit_steps: int
) -> tuple[Mapping[str, Tensor], BakingLoss | None]:
    """Columns of Gaussians with harmonics, and what these miss."""
    exact = exact_harmonics(splats, stored.cameras)
    if exact is not None:
        return exact.columns(), None
    if form is Form.EXACT_HARMONICS:
        fitting = [suffix for suffix, writer in WRITERS.items() if writer.form is Form.HARMONICS]
        remedy = f"fitted ones go into {' or '.join(fitting)}" if fitting else "train 3dgs for such a file"
        raise OutputError(
            f"{path}: cannot be written: it holds {form.value}, and the colours of {stored.header.method} are none; "
            f"{remedy}"
        )
    if not stored.cameras:
        raise ModelFileError(f"{path}: cannot be made: the model holds no training cameras; train it again")
    fitted, loss = fitted_harmonics(splats, stored.cameras, fit_steps)
    return fitted.columns(), loss
