"""nerfstudio and instant-ngp: one transforms.json, intrinsics for the file or per frame, maybe points in a PLY.

instant-ngp's ``aabb_scale`` and nerfstudio's ``applied_transform`` are not needed: poses and points are stored in the
same world, and training does not depend on its scale.
"""

from pathlib import Path

from ringlight.core.scene import PointCloud, Scene
from ringlight.data.capture import Capture, scene_from
from ringlight.data.folder import file_inside, image_inside, shown
from ringlight.data.frame import Frame
from ringlight.data.json_fields import Fields, read_object, text, texts
from ringlight.data.kept_pixels import Keeper
from ringlight.data.options import SceneOptions
from ringlight.data.ply_points import read_ply_points
from ringlight.data.splits import Split, split_of
from ringlight.data.transforms import read_frames
from ringlight.errors import SceneError

LOOKS_FOR = "transforms.json"

DEFAULT_POINTS = "sparse_pc.ply"
"""Where nerfstudio keeps SfM points if the JSON does not say."""


def recognises(folder: Path) -> bool:
    """Whether the folder holds a transforms.json."""
    return (folder / LOOKS_FOR).is_file()


def load(folder: Path, options: SceneOptions, keeper: Keeper | None = None) -> Scene:
    """The scene, split by the file's own lists of names or by holding out.

    Raises:
        SceneError: see :func:`ringlight.data.transforms.read_frames`; also a list that names no frame, and a
            damaged or missing point file.
    """
    file = folder / LOOKS_FOR
    document = read_object(file)
    frames = read_frames(document, file)
    split = split_of(frames, _listed_split(document, frames, file), options, file)
    return scene_from(Capture("nerfstudio", split, _points(document, file)), folder, options, keeper)


def _listed_split(document: Fields, frames: list[Frame], file: Path) -> Split | None:
    """What the file states: test images, or else validation images, are kept from training. An empty list means that
    there are none, and so does its absence where training images are listed: other frames are in no list."""
    train_names = texts(document, "train_filenames", str(file))
    test_key = "test_filenames" if "test_filenames" in document else "val_filenames"
    test_names = texts(document, test_key, str(file))
    if test_names is None:
        if train_names is None:
            return None
        note = f"split: train_filenames of {file.name}, which lists no test images: there are no test views"
        return Split(_named(frames, train_names, "train_filenames", file), [], note)
    test = _named(frames, test_names, test_key, file)
    none = "" if test else ", which is empty: there are no test views"
    if train_names is None:
        held_out = {frame.name for frame in test}
        left = [frame for frame in frames if frame.name not in held_out]
        return Split(left, test, f"split: {test_key} of {file.name}{none}")
    train = _named(frames, train_names, "train_filenames", file)
    return Split(train, test, f"split: train_filenames and {test_key} of {file.name}{none}")


def _named(frames: list[Frame], names: list[str], key: str, file: Path) -> list[Frame]:
    by_path = {frame.path: frame for frame in frames}
    chosen = []
    for name in names:
        path = image_inside(file.parent, name, f"{file}: {key}")
        if path not in by_path:
            raise SceneError(f"{file}: {key} names {shown(name)}, which no frame does; correct the list or remove it")
        chosen.append(by_path[path])
    return chosen


def _points(document: Fields, file: Path) -> PointCloud | None:
    stated = text(document, "ply_file_path", str(file))
    name = stated or DEFAULT_POINTS
    path = file_inside(file.parent, name, str(file))
    if path is not None:
        return read_ply_points(path)
    if stated is None:
        return None
    raise SceneError(f"{file}: the points {shown(name)} do not exist; copy the file there, or remove 'ply_file_path'")
