"""The pictures of a film on disk: for the eye, or as numbers; with one eye, with two, or all round."""

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, UInt8
from PIL import Image
from torch import Tensor

from ringlight.core.rendering import Channels
from ringlight.core.want import Want
from ringlight.errors import RecipeError
from ringlight.files.camera_records import refuse_other_numbers, write_camera_records
from ringlight.files.false_color import nearest_depth
from ringlight.files.layer_pictures import ALPHA, DEPTH_SAMPLES, common_depth_range, layer_pictures, looking
from ringlight.files.number_files import SUFFIXES, NumberFormat, scale_of, write_numbers
from ringlight.files.rigs import Rig, Stereo, bands, comfortable_baseline
from ringlight.files.video import save_8bit, to_8bit, write_video
from ringlight.models.contract import Model
from ringlight.runs.film import Film
from ringlight.runs.folder import make_folder
from ringlight.runs.opened import Opened

Tell = Callable[[int, int], None]

DEPTH_ROOM = 4.0
"""Of depths in 16 bits: the largest over the farthest that some of a film's views show, so that hardly any other view
shows a farther one, and a step is a sixteen-thousandth of that."""


def render_film(
    model: Model,
    film: Film,
    background: Float[Tensor, "3"],
    layers: Sequence[str],
    folder: Path,
    tell: Tell,
    rig: Rig,
) -> list[Path]:
    """One picture a frame and layer, ``folder/LAYER/NAME.png``, as the ``rig`` shows it; returns the layers' folders.

    The model, which has the layers, is asked for all of a frame at once. Raises OutputError where a picture cannot be
    written.
    """
    refuse_other_numbers(folder, "png", {})
    look = looking(model, background, layers)
    near_far = common_depth_range(partial(rig.see, look), film.cameras) if "depth" in layers else (0.0, 1.0)
    folders = {layer: make_folder(folder / layer) for layer in layers}
    for done, (camera, name) in enumerate(zip(film.cameras, film.names, strict=True), 1):
        pictures = _in_bytes(rig.see(look, camera), background, layers, near_far)
        for layer in layers:
            save_8bit(folders[layer] / name, pictures.pop(layer))
        tell(done, len(film.cameras))
    return list(folders.values())


def _in_bytes(
    found: Channels, background: Float[Tensor, "3"], layers: Sequence[str], near_far: tuple[float, float]
) -> dict[str, UInt8[np.ndarray, "H W c"]]:
    """The layers of a view as pictures, made by bands of rows: a panorama as floats would be held several times."""
    height, width = next(iter(found.values())).shape[:2]
    whole: dict[str, np.ndarray] = {}
    for rows in bands(height, width):
        band = {name: values[rows] for name, values in found.items()}
        for layer, picture in layer_pictures(band, background, layers, near_far).items():
            pixels = to_8bit(picture)
            whole.setdefault(layer, np.empty((height, width, pixels.shape[-1]), np.uint8))[rows] = pixels
    return whole


def render_numbers(
    model: Model,
    film: Film,
    background: Float[Tensor, "3"],
    layers: Sequence[str],
    folder: Path,
    tell: Tell,
    rig: Rig,
    kind: NumberFormat,
) -> int:
    """The same as numbers, of exact pictures, with ``cameras.json`` beside the layers' folders. Returns how many pixels
    were deeper than 16 bits hold, and have the largest value there.

    Raises OutputError, and BackendError for EXR without its library.
    """
    look = looking(model, background, layers, Want.EXACT)
    sampled = "depth" in layers and kind == "png16"
    farthest = common_depth_range(partial(rig.see, look), film.cameras)[1] if sampled else 1.0
    deepest = DEPTH_ROOM * farthest
    scales = {layer: scale_of(layer, deepest) for layer in layers}
    folders = {layer: make_folder(folder / layer) for layer in layers}
    names = [str(Path(name).with_suffix(SUFFIXES[kind])) for name in film.names]
    # First: numbers in 16 bits that an interrupt leaves without their step are worth nothing.
    write_camera_records(folder, rig, kind, scales, names, film.cameras)
    too_deep = 0
    for done, (camera, name) in enumerate(zip(film.cameras, names, strict=True), 1):
        found = rig.see(look, camera)
        too_deep += int((found["depth"] > deepest).sum()) if sampled else 0
        for layer in layers:
            write_numbers(folders[layer] / name, layer, found[layer], scales[layer])
        tell(done, len(film.cameras))
    return too_deep


def stereo_rig(opened: Opened, film: Film, baseline: float | None) -> Stereo:
    """Two eyes; without a ``baseline`` as far apart as suits the nearest surface that the film's cameras see. Raises
    RecipeError where they see none."""
    if baseline is None:
        look = looking(opened.stored.model, torch.zeros(3), ("depth",))
        step = max(len(film.cameras) // DEPTH_SAMPLES, 1)
        near = min(nearest_depth(seen["depth"], seen[ALPHA]) for seen in map(look, film.cameras[::step]))
        if not math.isfinite(near):
            raise RecipeError("the cameras see no surface that says how far apart the eyes are; give --stereo BASELINE")
        baseline = comfortable_baseline(near)
    return Stereo(baseline)


def film_to_video(pictures: Path, names: Sequence[str], fps: float, tell: Tell) -> None:
    """The pictures of one folder as ``FOLDER.mp4`` beside it. Raises BackendError without the video extra."""

    def frames() -> Iterator[Float[Tensor, "H W 3"]]:
        for done, name in enumerate(names, 1):
            with Image.open(pictures / name) as picture:
                yield torch.from_numpy(np.array(picture.convert("RGB"))).float() / 255
            tell(done, len(names))

    write_video(pictures.with_name(f"{pictures.name}.mp4"), frames(), fps)
