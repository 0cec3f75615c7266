"""A model's normals held against true ones, at the cameras of its scene's test views."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float

from ringlight.core.camera import Camera
from ringlight.core.scene import Scene
from ringlight.data.true_normals import TrueNormals, refuse_turned_away, views_of
from ringlight.errors import RecipeError
from ringlight.files.layer_pictures import ALPHA
from ringlight.files.video import save_8bit
from ringlight.measure.normal_error import AngleSums, NormalScore, compare_normals, score_of
from ringlight.measure.normal_picture import normal_picture
from ringlight.measure.picture_names import picture_name
from ringlight.runs.folder import make_folder
from ringlight.runs.opened import Opened

NORMAL = "normal"
"""The layer's name, see ``Model.layers``."""

Tell = Callable[[int, int], None]


@dataclass(frozen=True)
class MeasuredNormals:
    """Of one model: ``score`` over the pixels of all views, each pixel alike, and of each view by its name."""

    score: NormalScore
    views: tuple[tuple[str, NormalScore], ...]


def measure_normals(
    opened: Opened, scene: Scene, truth: TrueNormals, pictures: Path | None = None, tell: Tell | None = None
) -> MeasuredNormals:
    """Draw the model at each view that the file names, and compare; ``pictures`` is a folder for a picture of each.

    ``tell`` hears (views done, views in all). Raises SceneError where the file does not fit the scene, RecipeError for
    a model without normals, OutputError for a picture that cannot be written.
    """
    views = views_of(truth, scene)
    whole, scores = AngleSums(), []
    for done, (view, true) in enumerate(zip(views, truth.views(), strict=True), 1):
        refuse_turned_away(true, view, truth)
        compared = compare_normals(*_layers(opened, view.camera), true)
        whole.add(compared)
        scores.append((view.name, score_of(compared)))
        if pictures is not None:
            path = make_folder(pictures, "--pictures") / picture_name(view.name)
            save_8bit(path, np.asarray(normal_picture(compared, *scores[-1])))
        if tell is not None:
            tell(done, len(views))
    return MeasuredNormals(whole.score(), tuple(scores))


def _layers(opened: Opened, camera: Camera) -> tuple[Float[np.ndarray, "H W 3"], Float[np.ndarray, "H W 1"]]:
    """World normals and alpha. Raises RecipeError for a model without normals."""
    with torch.no_grad():
        shown = opened.stored.model.layers(camera)
    if NORMAL not in shown:
        method = opened.stored.header.method
        raise RecipeError(f"{opened.file}: models of {method} have no normals; leave this one out")
    return shown[NORMAL].cpu().numpy(), shown[ALPHA].cpu().numpy()
