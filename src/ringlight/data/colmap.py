"""COLMAP: sparse/0 (or sparse itself, or several sub-models) and images/, binary or text.

Rigs and frames (rigs.bin, frames.bin of COLMAP 3.12 and later) add nothing to images that are already posed and are
not read. A model with points but without observations is fine.
"""

import shlex
from dataclasses import dataclass, replace
from pathlib import Path

from ringlight.core.scene import WARNING, Scene
from ringlight.core.stages import counted
from ringlight.data import colmap_binary, colmap_text
from ringlight.data.capture import Capture, scene_from
from ringlight.data.colmap_model import ColmapImage, intrinsics_of
from ringlight.data.folder import image_inside, require_none_missing, shown
from ringlight.data.frame import Frame
from ringlight.data.image_files import read_header
from ringlight.data.intrinsics import Intrinsics
from ringlight.data.kept_pixels import Keeper
from ringlight.data.options import SceneOptions
from ringlight.data.photograph_folder import PhotographFolder, photograph_folder
from ringlight.data.poses import camera_of, world_to_camera_from_quaternion
from ringlight.data.splits import split_of
from ringlight.data.undistort import undistortion_of
from ringlight.errors import SceneError

LOOKS_FOR = "sparse/0/cameras.bin or .txt"

READERS = {".bin": colmap_binary, ".txt": colmap_text}
"""Binary first: where a folder holds both, COLMAP reads binary."""


@dataclass(frozen=True)
class SubModel:
    """One reconstruction: where it lies, its file suffix, and its registered images."""

    folder: Path
    suffix: str
    images: list[ColmapImage]


def recognises(folder: Path) -> bool:
    """Whether the folder holds a COLMAP model."""
    return bool(_model_folders(folder))


def load(folder: Path, options: SceneOptions, keeper: Keeper | None = None) -> Scene:
    """The scene of the largest sub-model; every n-th image by name is a test image.

    Raises:
        SceneError: damaged files, images that are missing or outside the folder, a lens that cannot be undistorted.
    """
    models = [
        SubModel(path, suffix, READERS[suffix].read_images(path / f"images{suffix}"))
        for path, suffix in _model_folders(folder)
    ]
    model = max(models, key=lambda candidate: len(candidate.images))
    if not model.images:
        raise SceneError(f"{model.folder}: registers no images; run the mapper with more overlapping photographs")
    notes = _model_note(models, model)
    photographs = photograph_folder(folder, [image.name for image in model.images], options)
    frames = _frames(model, photographs, folder)
    split = split_of(frames, None, options, model.folder)
    path = model.folder / f"points3D{model.suffix}"
    points = READERS[model.suffix].read_points(path) if path.is_file() else None
    capture = Capture("colmap", split, points, (*notes, f"photographs: {_name(photographs.path, folder)}"))
    options = replace(options, downscale=1) if photographs.divided > 1 else options
    return scene_from(capture, folder, options, keeper)


def _model_folders(folder: Path) -> list[tuple[Path, str]]:
    sparse = folder / "sparse"
    if not sparse.is_dir():
        return []
    candidates = [sparse, *sorted(path for path in sparse.iterdir() if path.is_dir())]
    suffixes = [next((one for one in READERS if (path / f"cameras{one}").is_file()), None) for path in candidates]
    return [(path, suffix) for path, suffix in zip(candidates, suffixes, strict=True) if suffix]


def _model_note(models: list[SubModel], chosen: SubModel) -> tuple[str, ...]:
    if len(models) == 1:
        return ()
    counts = ", ".join(f"{model.folder.name}: {len(model.images)}" for model in models)
    return (
        f"{WARNING}COLMAP split the photographs into {len(models)} models ({counts} images); only the largest, "
        f"{chosen.folder.name}, is used",
    )


def _name(photographs: Path, folder: Path) -> str:
    """In the scene's folder, or whole."""
    return photographs.name if photographs.parent == folder else str(photographs)


def _frames(model: SubModel, photographs: PhotographFolder, folder: Path) -> list[Frame]:
    images = photographs.path
    source = model.folder / f"images{model.suffix}"
    lenses = _lenses(model, images, folder)
    found, missing = [], []
    for image in model.images:
        where = f"{source}: image {shown(image.name)}"
        path = image_inside(images, image.name, where)
        if path is None:
            missing.append((str(source), image.name))
        else:
            found.append((image, path, where))
    require_none_missing(missing, len(model.images), images)
    for image, path, _ in found:
        lens = lenses[image.camera_id]
        photographs.refuse_other_size(path, image.name, (lens.width, lens.height))
    looked = counted("looking at photographs", found)
    return [_frame(image, lenses[image.camera_id], path, where) for image, path, where in looked]


def _lenses(model: SubModel, images: Path, folder: Path) -> dict[int, Intrinsics]:
    """The cameras that the images use, without poses; a camera of no image may be of any kind."""
    source = model.folder / f"cameras{model.suffix}"
    cameras = READERS[model.suffix].read_cameras(source)
    undistorted = shlex.quote(str(folder / "undistorted"))
    remedy = (
        f"undistort with: colmap image_undistorter --image_path {shlex.quote(str(images))} "
        f"--input_path {shlex.quote(str(model.folder))} --output_path {undistorted}, and train on {undistorted}"
    )
    lenses = {}
    for camera_id in sorted({image.camera_id for image in model.images}):
        if camera_id not in cameras:
            raise SceneError(f"{source}: lacks camera {camera_id}, which an image uses; copy the model again")
        lenses[camera_id] = intrinsics_of(cameras[camera_id], f"{source}: camera {camera_id}", remedy)
    return lenses


def _frame(image: ColmapImage, lens: Intrinsics, path: Path, where: str) -> Frame:
    header = read_header(path)
    pose = world_to_camera_from_quaternion(image.quaternion, image.translation, where)
    photographed = lens.on_image(header.width, header.height, where)
    undistortion = undistortion_of(photographed, where)
    camera = camera_of(pose, undistortion.pinhole if undistortion else photographed)
    return Frame(image.name, path, camera, header, undistortion=undistortion)
