"""A PLY of 3D Gaussian Splatting, from whatever program, as a model of the method ``3dgs``."""

from dataclasses import asdict
from pathlib import Path

import numpy as np

from ringlight.core.gradients import COLUMNS
from ringlight.data.options import SceneOptions
from ringlight.data.points import sfm_box
from ringlight.errors import ModelFileError
from ringlight.files.model_file import SceneFacts
from ringlight.files.ply import read_gaussian_ply
from ringlight.methods.store import StoredModel, model_header, save_model
from ringlight.methods.three_dgs import ThreeDGSRecipe
from ringlight.rasterize.choose import host_rasterizer

PLY = ".ply"

DEGREES = {0: 0, 3: 1, 8: 2, 15: 3}
"""Of the harmonics, by the number of coefficients beside the constant one."""


def model_of_ply(path: Path) -> StoredModel:
    """The model in a PLY: every number as it is in the file.

    The file says neither cameras nor photographs; the box is that of the Gaussians, without stray ones, and the extent
    half its longest side. Raises ModelFileError.
    """
    read = read_gaussian_ply(path)
    gaussians = read.gaussians
    if len(gaussians) == 0:
        raise ModelFileError(f"{path}: the PLY holds no Gaussian; name another file, or export it again")
    degree = DEGREES[gaussians.appearance["sh_rest"].shape[1]]
    recipe = ThreeDGSRecipe(sh_degree=degree, antialiased=read.antialiased).at_length()
    with np.errstate(over="ignore"):
        box, rasterize = sfm_box(gaussians.means), host_rasterizer()
    if not (box[1] - box[0]).isfinite().all():
        raise ModelFileError(
            f"{path}: its Gaussians lie too far apart for numbers of 32 bits; export it again in larger units"
        )
    model = recipe.model(box, rasterize)
    columns = {COLUMNS + name: column for name, column in gaussians.columns().items()}
    model.load_tensors(model.state_dict() | columns)
    low, high = (tuple(corner) for corner in box.tolist())
    facts = SceneFacts(
        name=path.stem,
        source=str(path.resolve()),
        background="photograph",
        resolution=(0, 0),
        box=(low, high),
        extent=0.5 * float((box[1] - box[0]).max()),
        notes=(f"imported from {path.name}, which says neither cameras nor photographs",),
        options=asdict(SceneOptions()),
    )
    return StoredModel(model.eval(), model_header("3dgs", recipe, 0, facts), (), rasterize)


def write_imported(stored: StoredModel, path: Path) -> None:
    """The model file. Raises OutputError."""
    save_model(path, stored.model, stored.header, stored.cameras)
