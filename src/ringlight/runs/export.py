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
        surface = "" if stored.model.solid() is None else "--mesh and --points write its surface, and "
        raise OutputError(
            f"{path}: cannot be written: it holds {writer.form.value}, and this model is made of {count.noun}; "
            f"{surface}'ringlight render' makes pictures of it"
        )
    else:
        tensors, loss = _harmonics(stored, splats, path, writer.form, fit_steps)
        count = Count(len(tensors["means"]), count.noun)
    writer.write(path, Content(tensors, splats is not None and splats.options.antialiased, (_note(stored),)))
    return Exported(str(path), count.number, count.noun, path.stat().st_size, loss)


def check_surface_target(path: Path, overwrite: bool) -> None:
    """Raises OutputError for a suffix that surfaces do not have, or a file that exists and may not be replaced."""
    if path.suffix.lower() != ".ply":
        raise OutputError(f"{path}: cannot be written: a surface is a PLY file; end its name in .ply")
    refuse_existing(path, overwrite)


def export_surface(stored: StoredModel, path: Path, with_triangles: bool) -> Exported:
    """Write the surface of a volume, as a mesh or as points with normals and colours.

    Raises OutputError where the model has no density or no surface, or the file cannot be written, BackendError without
    the extra.
    """
    solid = stored.model.solid()
    count, _ = stored.model.rendering_size()
    if solid is None:
        raise OutputError(
            f"{path}: cannot be written: a surface is found in a volume's density, and this model is made of "
            f"{count.noun}; export without --mesh and --points"
        )
    from ringlight.files.surface_ply import write_surface_ply
    from ringlight.runs.surface import surface_of

    found = surface_of(solid, str(path))
    triangles = found.triangles if with_triangles else None
    write_surface_ply(path, found.corners, found.normals, found.colors, triangles, (_note(stored),))
    number, noun = (len(found.corners), "points") if triangles is None else (len(triangles), "triangles")
    return Exported(str(path), number, noun, path.stat().st_size, None)


def _note(stored: StoredModel) -> str:
    return f"ringlight {ringlight.__version__}, {stored.header.preset}, {stored.header.scene.name}"


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
